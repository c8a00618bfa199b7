"""What a user chooses about a conversion; nothing is imported here that the command line does not need."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mdrive_sumo.scenario.background import BackgroundMode
    from real2sim.logged_drive import ConfirmedInfraction
    from real2sim.readers.time_grid import TimeWindow

NETWORKS = "networks"
"""Folder of the networks in a suite."""


@dataclass(frozen=True)
class ConversionOptions:
    """Options for the traffic of a scenario."""

    mode: "BackgroundMode" = "reactive"
    cavs: tuple[str, ...] = ()
    """Names of observers or tracks; (): the CAVs of the source, else one is chosen."""
    window_s: "TimeWindow | None" = None
    """The part of the log that the scene covers, for the report."""
    confirmed: "tuple[ConfirmedInfraction, ...]" = ()
    """Infractions of logged drives that a person has confirmed."""
