"""Ghosts: stand-ins on every lane that something overlaps without SUMO seeing it there (sumo_pitfalls 1.5)."""

# pyright: basic
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.sumo.placed_vehicles import GHOST

CORRIDOR_M = 1.8
"""Width of the strip that a background vehicle sweeps on its lane: SUMO's default passenger car."""
SHORTEST_M = 0.5
"""Least length of a ghost."""


@dataclass(frozen=True, slots=True)
class Body:
    """What SUMO's traffic shall notice: SUMO id of its double (or what would be it), box, speed along its yaw."""

    name: str
    x: float
    y: float
    yaw: float
    speed: float
    length: float
    width: float
    seen_on: str = ""
    """The lane where SUMO sees it by a double of its own: no ghost is needed there."""


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
        if self.speed == 0.0:
            return self
        return Ghost(self.body, self.lane, self.front_s + self.speed * DT, self.length, self.speed)


def ghosts_of(bodies: Sequence[Body], roads: RoadMap) -> dict[str, Ghost]:
    """By SUMO id, a ghost for every lane whose vehicle corridor a body overlaps, but for the lane it is seen on."""
    if not bodies:
        return {}
    strips = _corridors(roads)
    boxes = shapely.polygons([box_corners(b.x, b.y, b.yaw, b.length, b.width) for b in bodies])
    found = zip(*strips.tree.query(boxes, predicate="intersects").tolist(), strict=True)
    pairs = sorted((b, lane) for b, lane in found if roads.driving[lane].id != bodies[b].seen_on)
    return dict(_ghosts(bodies, pairs, boxes, roads)) if pairs else {}


def _ghosts(
    bodies: Sequence[Body], pairs: list[tuple[int, int]], boxes: Any, roads: RoadMap
) -> Iterator[tuple[str, Ghost]]:
    body, lane = np.array(pairs).T
    first, last = _extents(boxes[body], lane, _corridors(roads))
    for (b, found), begin, end in zip(pairs, first.tolist(), last.tolist(), strict=True):
        one, on = bodies[b], roads.driving[found]
        length = max(end - begin, SHORTEST_M)
        front = max(end, length)  # its rear is on this lane too: SUMO loses track of ghosts on two lanes
        along = one.speed * math.cos(one.yaw - on.centre.yaw_at(end)) if one.speed else 0.0
        yield f"{GHOST}{one.name}:{on.id}", Ghost(one.name, on, front, length, max(along, 0.0))


def _extents(boxes: Any, lane: Any, strips: "_Corridors") -> tuple[Float, Float]:
    """Least and greatest arc length (P,) [m] on the lanes (P,) of what the boxes (P,) have of their strips."""
    shared = shapely.intersection(boxes, strips.tree.geometries[lane])
    corners, pair = shapely.get_coordinates(shared, return_index=True)
    stations = shapely.line_locate_point(strips.lines[lane[pair]], shapely.points(corners))
    starts = np.flatnonzero(np.diff(pair, prepend=-1))
    return np.minimum.reduceat(stations, starts), np.maximum.reduceat(stations, starts)


@dataclass(frozen=True, slots=True)
class _Corridors:
    """Centre lines (L,) and the strips that background vehicles sweep, in the order of `RoadMap.driving`."""

    lines: Any
    tree: shapely.STRtree


@lru_cache(maxsize=8)
def _corridors(roads: RoadMap) -> _Corridors:
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in roads.driving], dtype=object)
    return _Corridors(lines, shapely.STRtree(shapely.buffer(lines, CORRIDOR_M / 2, cap_style="flat")))
