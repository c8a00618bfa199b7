"""Scene: what every reader hands to the builder, whatever the source: one scenario to be.

A log brings a recording (map, tracks); an authored source brings routes of CAVs, road users with their behaviours and
things beside the road. Everything is in the frame of the map: metres, right-handed, radians counter-clockwise from +x.
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
    """A CARLA town: a ready map that netconvert reads. Its frame is CARLA's with y flipped, before SUMO's netOffset."""

    name: str
    maps: Path
    """Folder with NAME.xodr or NAME.net.xml."""


@dataclass(frozen=True)
class CavRoute:
    """A CAV whose way was authored: via points, the first is where it starts."""

    id: str
    waypoints: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) [m], N >= 2."""


@dataclass(frozen=True)
class SourceScene:
    """One scenario to be."""

    id: str
    source: str
    """Name of the reader."""
    bucket: str
    category: str
    map: HdMap | TownMap
    recording: Recording | None = None
    """Tracks of a log; its map is `map`."""
    routes: tuple[CavRoute, ...] = ()
    """Authored CAVs; those of a log come from its tracks."""
    actors: tuple[Actor, ...] = ()
    """Authored road users with their behaviours, and environment objects; those of a log come from its tracks."""
    weather: WeatherName = "default"
    description: str = ""
    notes: tuple[str, ...] = ()
    """What the reader had to pass over or to guess, for the report."""
