"""HdMap: the map of a log, whatever its source, in the log's own frame [m]."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from mdrive_sumo.core.geometry import Float


class LaneKind(StrEnum):
    """Who uses a lane."""

    DRIVING = "driving"
    BIKE = "bike"
    SIDEWALK = "sidewalk"
    SHOULDER = "shoulder"
    PARKING = "parking"


@dataclass(frozen=True)
class MapLane:
    """One lane as the source draws it."""

    id: str
    kind: LaneKind
    centre: Float
    """(N, 2), N >= 2."""
    left: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(M, 2) boundary to the left in the order of the points; empty if unknown."""
    right: Float = field(default_factory=lambda: np.zeros((0, 2)))
    entries: tuple[str, ...] = ()
    """Ids of lanes that lead into this one, as the source says; may be incomplete or name lanes that are not there."""
    exits: tuple[str, ...] = ()
    left_neighbour: str = ""
    """Lane to the left of the same direction; "" if there is none or the source does not say."""
    right_neighbour: str = ""
    group: str = ""
    """Road or segment that the source counts it to; lanes of one group lie side by side."""
    width: float = float("nan")
    """[m]; NaN if the source says nothing (boundaries tell more)."""
    speed_limit: float = float("nan")
    """[m/s]"""
    directed: bool = True
    """Whether the order of its points is the direction of travel; False: to be voted (V2XPnP)."""
    junction: bool = False
    """Whether the source says that it lies within a junction."""


@dataclass(frozen=True)
class StopLine:
    """Where vehicles of some lanes stop: end points (2, 2) [m]."""

    line: Float
    lanes: tuple[str, ...] = ()
    sign: str = ""
    """"stop", "yield", "signal" or ""."""


@dataclass(frozen=True)
class HdMap:
    """Lanes and what lies on them."""

    lanes: Mapping[str, MapLane] = field(default_factory=dict[str, MapLane])
    crosswalks: tuple[Float, ...] = ()
    """Polygons (N, 2) [m]."""
    stop_lines: tuple[StopLine, ...] = ()
    signals: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Ids of traffic lights with the lanes that they control."""
    left_hand: bool | None = None
    """Whether traffic keeps to the left; None: to be found out."""
