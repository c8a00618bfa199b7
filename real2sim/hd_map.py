"""HdMap: the map of a log in the log's own frame [m], independent of the source."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from mdrive_sumo.core.geometry import Float


class LaneKind(StrEnum):
    """Kind of traffic that uses a lane."""

    DRIVING = "driving"
    BIKE = "bike"
    SIDEWALK = "sidewalk"
    SHOULDER = "shoulder"
    PARKING = "parking"


@dataclass(frozen=True)
class MapLane:
    """One lane as the source defines it."""

    id: str
    kind: LaneKind
    centre: Float
    """Points (N, 2) [m] of the centre line, N >= 2."""
    left: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(M, 2) [m] left boundary in the order of the points; empty if unknown."""
    right: Float = field(default_factory=lambda: np.zeros((0, 2)))
    entries: tuple[str, ...] = ()
    """Ids of predecessor lanes as given by the source; may be incomplete or refer to missing lanes."""
    exits: tuple[str, ...] = ()
    left_neighbour: str = ""
    """Id of the left neighbour with the same direction; "" if there is none or the source does not say."""
    right_neighbour: str = ""
    group: str = ""
    """Road or segment of the source; lanes of one group lie side by side."""
    width: float = float("nan")
    """[m]; NaN if the source gives none (the boundaries may)."""
    speed_limit: float = float("nan")
    """Speed limit [m/s]; NaN if the source gives none."""
    directed: bool = True
    """Whether the order of the points is the direction of travel; False: the direction must be estimated (V2XPnP)."""
    junction: bool = False
    """Whether the source marks the lane as part of a junction."""


@dataclass(frozen=True)
class StopLine:
    """Stop line of some lanes: end points (2, 2) [m]."""

    line: Float
    lanes: tuple[str, ...] = ()
    sign: str = ""
    """"stop", "yield", "signal" or ""."""


@dataclass(frozen=True)
class MapArea:
    """A valid polygon: outline and holes, corners (N, 2) [m] each without the first one again."""

    outline: Float
    holes: tuple[Float, ...] = ()


@dataclass(frozen=True)
class HdMap:
    """Lanes, crosswalks, stop lines, signals, drivable areas and buildings of a map."""

    lanes: Mapping[str, MapLane] = field(default_factory=dict[str, MapLane])
    crosswalks: tuple[Float, ...] = ()
    """Outlines (N, 2) [m] of the crosswalks."""
    stop_lines: tuple[StopLine, ...] = ()
    signals: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Ids of traffic lights with the ids of the lanes they control."""
    left_hand: bool | None = None
    """Whether traffic keeps to the left; None: unknown, to be estimated."""
    drivable_areas: tuple[MapArea, ...] = ()
    """Where vehicles may drive or park, lanes included if the source says so; for pictures."""
    buildings: tuple[MapArea, ...] = ()
    """What blocks sight and stops cars; no log's map has any, that of a drawn place does."""
    observed_areas: tuple[MapArea, ...] = ()
    """Where vehicles of the log drive or stand beyond lanes and drivable areas; for pictures."""
