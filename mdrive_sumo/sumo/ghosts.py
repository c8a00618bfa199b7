"""Ghosts: stand-ins on every lane that something overlaps without SUMO seeing it there (sumo_pitfalls 1.5)."""

# pyright: basic
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.geometry import box_corners
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.state import DT
from mdrive_sumo.sumo.remote import GHOST

CORRIDOR_M = 1.8
"""Width of the strip that a background vehicle sweeps on its lane: SUMO's default passenger car."""


@dataclass(frozen=True, slots=True)
class Ghost:
    """A stand-in on a lane that a body overlaps without being on it, so that SUMO's traffic sees it there."""

    body: str
    """SUMO id of what it stands for."""
    lane: Lane
    front_s: float
    """Arc length [m] on the lane of the foremost point of the overlap."""
    length: float
    speed: float

    def moved(self) -> "Ghost":
        """The ghost one tick later, if its body goes on as it does."""
        return Ghost(self.body, self.lane, self.front_s + self.speed * DT, self.length, self.speed)


def ghosts_of(
    body: str, pose: tuple[float, float, float], speed: float, size: tuple[float, float], seen_on: str, roads: RoadMap
) -> dict[str, Ghost]:
    """By SUMO id, a ghost for every lane whose vehicle corridor a box (x, y, yaw; length, width) overlaps.

    None for `seen_on`, the lane where SUMO sees the body itself.
    """
    box = shapely.polygons(box_corners(*pose, *size))
    strips = _corridors(roads)
    found: dict[str, Ghost] = {}
    for i in sorted(strips.tree.query(box, predicate="intersects")):
        lane = roads.driving[i]
        if lane.id == seen_on:
            continue
        corners = shapely.get_coordinates(shapely.intersection(box, strips.tree.geometries[i]))
        stations = shapely.line_locate_point(strips.lines[i], shapely.points(corners))
        front, along = float(stations.max()), speed * math.cos(pose[2] - lane.centre.yaw_at(stations.max()))
        length = max(front - float(stations.min()), 0.5)
        found[f"{GHOST}{body}:{lane.id}"] = Ghost(body, lane, front, length, max(along, 0.0))
    return found


@dataclass(frozen=True, slots=True)
class _Corridors:
    """Centre lines (L,) and the strips that background vehicles sweep, in the order of `RoadMap.driving`."""

    lines: Any
    tree: shapely.STRtree


@lru_cache(maxsize=8)
def _corridors(roads: RoadMap) -> _Corridors:
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in roads.driving], dtype=object)
    return _Corridors(lines, shapely.STRtree(shapely.buffer(lines, CORRIDOR_M / 2, cap_style="flat")))
