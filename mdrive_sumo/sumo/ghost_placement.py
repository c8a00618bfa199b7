"""Ghost vehicles: placeholders on every lane that a box overlaps without SUMO knowing (sumo_pitfalls 1.5)."""

# pyright: basic
# Because shapely's array functions have no precise types.
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.sumo.placed_vehicles import GHOST

CORRIDOR_M = 1.8
"""Width [m] of the strip that a background vehicle sweeps on its lane: SUMO's default passenger car."""
CYCLE_CORRIDOR_M = 1.0
"""[m] The same of cyclists on cycle lanes: the room that ERA 2010 takes for one who rides."""
SHORTEST_M = 0.5
"""Least length [m] of a ghost."""


@dataclass(frozen=True, slots=True)
class SourceBox:
    """A box that SUMO's traffic must react to: id, centre [m], yaw [rad], speed along yaw [m/s], dimensions [m]."""

    name: str
    x: float
    y: float
    yaw: float
    speed: float
    length: float
    width: float
    visible_lane: str = ""
    """Lane on which SUMO has a placed vehicle for it, so that it needs no ghost there; "" if none."""


@dataclass(frozen=True, slots=True)
class Ghost:
    """A placeholder on a lane that a source overlaps."""

    source_id: str
    """Id of the box that it represents."""
    lane: Lane
    front_s: float
    """Arc length [m] on the lane of the foremost point of the overlap."""
    length: float
    speed: float

    def advance(self) -> "Ghost":
        """Return the ghost one tick later, at constant speed."""
        if self.speed == 0.0:
            return self
        return Ghost(self.source_id, self.lane, self.front_s + self.speed * DT, self.length, self.speed)


def find_ghosts(sources: Sequence[SourceBox], roads: RoadMap) -> dict[str, Ghost]:
    """Return a ghost, by SUMO id, for every lane whose vehicle corridor a source overlaps, except its visible lane."""
    if not sources:
        return {}
    strips = _build_corridors(roads)
    corners = np.array([box_corners(b.x, b.y, b.yaw, b.length, b.width) for b in sources])
    near = find_near_pairs(corners, strips.bounds)
    pairs = [(b, lane) for b, lane in near if strips.lanes[lane].id != sources[b].visible_lane]
    if not pairs:
        return {}
    boxes: Any = shapely.polygons(corners)
    source, lane = np.array(pairs).T
    meet = shapely.intersects(strips.areas[lane], boxes[source]).tolist()
    pairs = list(compress(pairs, meet))
    return dict(_build_ghosts(sources, pairs, boxes, roads)) if pairs else {}


@twin
def find_near_pairs(corners: Float, bounds: Float, /) -> list[tuple[int, int]]:
    """Return the indices of boxes, corners (S, 4, 2) [m], and areas that their bounds touch, in order.

    bounds: (L, 4) least x and y, greatest x and y [m] of the areas.
    """
    low, high = corners.min(axis=1)[:, None], corners.max(axis=1)[:, None]
    touch = ((low <= bounds[:, 2:]) & (bounds[:, :2] <= high)).all(axis=-1)
    return [(i, j) for i, j in np.argwhere(touch).tolist()]


def _build_ghosts(
    sources: Sequence[SourceBox], pairs: list[tuple[int, int]], boxes: Any, roads: RoadMap
) -> Iterator[tuple[str, Ghost]]:
    source, lane = np.array(pairs).T
    strips = _build_corridors(roads)
    first, last = _compute_extents(boxes[source], lane, strips)
    for (b, found), begin, end in zip(pairs, first.tolist(), last.tolist(), strict=True):
        one, on = sources[b], strips.lanes[found]
        length = max(end - begin, SHORTEST_M)
        front = max(end, length)  # the rear must be on this lane as well: SUMO loses vehicles that span two lanes
        along = one.speed * portable.cos(one.yaw - on.centre.yaw_at(end)) if one.speed else 0.0
        yield f"{GHOST}{one.name}:{on.id}", Ghost(one.name, on, front, length, max(along, 0.0))


def _compute_extents(boxes: Any, lane: Any, strips: "_Corridors") -> tuple[Float, Float]:
    """Return least and greatest arc length (P,) [m] on the lanes (P,) of the overlap of boxes (P,) and corridors."""
    shared = shapely.intersection(boxes, strips.areas[lane])
    corners, pair = shapely.get_coordinates(shared, return_index=True)
    stations = shapely.line_locate_point(strips.lines[lane[pair]], shapely.points(corners))
    starts = np.flatnonzero(np.diff(pair, prepend=-1))
    return np.minimum.reduceat(stations, starts), np.maximum.reduceat(stations, starts)


@dataclass(frozen=True, slots=True)
class _Corridors:
    """Centre lines (L,) and strips that background vehicles sweep, of lanes for cars and cycle lanes beside them."""

    lanes: tuple[Lane, ...]
    lines: Any
    areas: Any
    bounds: Float
    """(L, 4) Least x and y, greatest x and y [m]."""


@lru_cache(maxsize=64)
def _build_corridors(roads: RoadMap) -> _Corridors:
    car_edges = {lane.edge for lane in roads.driving}
    beside = [lane for lane in roads.cycle_lanes.values() if lane.edge in car_edges]  # SUMO adds no car to another edge
    lanes = (*roads.driving, *beside)
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in lanes], dtype=object)
    half_widths = [CORRIDOR_M / 2] * len(roads.driving) + [CYCLE_CORRIDOR_M / 2] * len(beside)
    areas = shapely.buffer(lines, half_widths, cap_style="flat")
    shapely.prepare(areas)
    return _Corridors(lanes, lines, areas, np.asarray(shapely.bounds(areas)))
