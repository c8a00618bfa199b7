"""Disposition: what each track of a log becomes in the scenario, and why."""

from dataclasses import dataclass
from enum import StrEnum


class Disposition(StrEnum):
    """What a track of the log becomes in the scenario."""

    CAV = "CAV"
    BACKGROUND = "background"
    """A vehicle that SUMO drives along its schedule."""
    ACTOR = "actor"
    """A scripted road user on its path of the log."""
    STANDING = "standing"
    """An object that never moves."""
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class TrackRole:
    """Disposition of one track and its reason; "" if the reason is obvious."""

    disposition: Disposition
    reason: str = ""
