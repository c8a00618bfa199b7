"""SourceScene: what every reader hands to the scenario builder, independent of the source.

A log provides a recording (map, tracks); an authored source provides routes of CAVs, scripted road users and props. All
coordinates are in the frame of the map: metres, right-handed, radians counter-clockwise from +x.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.weather import WeatherName
from real2sim.hd_map import HdMap
from real2sim.recording import Recording


@dataclass(frozen=True)
class TownMap:
    """A CARLA town: a map that netconvert reads. Its frame is CARLA's with y flipped, before SUMO's netOffset."""

    name: str
    map_folder: Path
    """Folder with NAME.xodr or NAME.net.xml."""


@dataclass(frozen=True)
class CavRoute:
    """Authored route of a CAV: via points, starting with the start position."""

    id: str
    waypoints: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """Via points (N, 2) [m], N >= 2."""


@dataclass(frozen=True)
class SourceScene:
    """Source of one scenario."""

    id: str
    source: str
    """Name of the reader that has read it."""
    bucket: str
    category: str
    map: HdMap | TownMap
    recording: Recording | None = None
    """Tracks of a log; its map is `map`."""
    routes: tuple[CavRoute, ...] = ()
    """Authored CAVs; CAVs of a log come from its tracks."""
    actors: tuple[Actor, ...] = ()
    """Authored road users and props; those of a log come from its tracks."""
    weather: WeatherName = "default"
    description: str = ""
    notes: tuple[str, ...] = ()
    """What the reader skipped or assumed, for the report."""
