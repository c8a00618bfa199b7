"""Where people walk: along pavements and round corners, and the ways on which they cross streets."""

import random
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import Footway, RoadMap

Spot = tuple[float, float]
END_M = 1.0
"""[m] People turn back or round the corner this far before the end of a pavement."""
CORNER_M = 14.0
"""[m] Two ends of pavements that are nearer than this, without a lane between, are one corner."""
SIDE_M = 0.4
"""[m] People keep this far from the edges of a pavement."""
BEHIND_KERB_M = 0.7
"""[m] People wait to cross this far behind the kerb."""
PROBE_M, WIDEST_M = 0.25, 22.0
"""[m] Step of the search for the other kerb; wider carriageways are not crossed without a zebra crossing."""
JUNCTION_M = 18.0
"""[m] People do not cross this close to the end of a pavement without a zebra crossing: they use the junction there."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A way over a street: from behind one kerb to behind the other."""

    start: Spot
    end: Spot
    width: float
    """Width [m] of the zebra crossing; 0 without one."""


@lru_cache(maxsize=32)
def find_zebra_crossings(roads: RoadMap) -> tuple[Crossing, ...]:
    """Return the zebra crossings of a network, each once."""
    found: list[Crossing] = []
    for line, width in roads.crossings:
        (x0, y0), (x1, y1) = line[0].tolist(), line[-1].tolist()
        length = portable.distance((x0, y0), (x1, y1))
        dx, dy = (x1 - x0) / length * BEHIND_KERB_M, (y1 - y0) / length * BEHIND_KERB_M
        found.append(Crossing((x0 - dx, y0 - dy), (x1 + dx, y1 + dy), width))
    return tuple(found)


@lru_cache(maxsize=32)
def _build_lane_area(roads: RoadMap) -> shapely.Geometry:
    """Return the area of all lanes."""
    lines = [shapely.LineString(lane.centre.xy) for lane in (*roads.driving, *roads.cycle_lanes.values())]
    widths = [lane.width / 2 for lane in (*roads.driving, *roads.cycle_lanes.values())]
    area = shapely.union_all(shapely.buffer(lines, widths, cap_style="flat"))
    shapely.prepare(area)
    return area


@lru_cache(maxsize=32)
def find_corners(roads: RoadMap) -> dict[tuple[int, bool], tuple[int, bool]]:
    """Return the end of a pavement that each end leads to round a corner; (index, whether it is the last point)."""
    ends = {(k, last): _find_end(way, last) for k, way in enumerate(roads.footways) for last in (False, True)}
    area, corners = _build_lane_area(roads), dict[tuple[int, bool], tuple[int, bool]]()
    for key, spot in ends.items():
        others = sorted((portable.distance(spot, other), name) for name, other in ends.items() if name[0] != key[0])
        for distance, name in others:
            if distance > CORNER_M:
                break
            if not shapely.intersects(area, shapely.LineString((spot, ends[name]))):
                corners[key] = name
                break
    return corners


def _find_end(way: Footway, last: bool) -> Spot:
    return way.centre.at(max(way.centre.length - END_M, 0.0) if last else min(END_M, way.centre.length))


def draw_walk(roads: RoadMap, begin: tuple[int, float, bool], length_m: float, side: float) -> tuple[Spot, ...]:
    """Return the points of a walk along pavements of at least a length [m].

    begin: index of the pavement, station [m], and whether people walk towards its last point; side: offset [m] to the
    left of the way. At a corner the walk goes round it, at any other end it turns back on the other side of the way.
    """
    corners, (k, station, forward) = find_corners(roads), begin
    points, walked = [_place(roads.footways[k].centre, station, forward, side)], 0.0
    while walked < length_m:
        way = roads.footways[k]
        end = max(way.centre.length - END_M, station) if forward else min(END_M, station)
        points += _follow(way.centre, station, end, forward, side)
        walked += abs(end - station) + 2 * abs(side) + 0.5
        if (corner := corners.get((k, forward))) is not None:
            k, forward = corner[0], not corner[1]
            length = roads.footways[k].centre.length
            station = min(END_M, length) if forward else max(length - END_M, 0.0)
        else:
            forward, station = not forward, end
        points.append(_place(roads.footways[k].centre, station, forward, side))
    return _drop_repeated(points)


def _follow(centre: Polyline, start: float, end: float, forward: bool, side: float) -> list[Spot]:
    """Return the points at the corners of a line between two stations, and at its end."""
    inner = centre.s[(centre.s > min(start, end) + 0.5) & (centre.s < max(start, end) - 0.5)].tolist()
    return [_place(centre, station, forward, side) for station in (*(inner if forward else inner[::-1]), end)]


def _place(centre: Polyline, station: float, forward: bool, side: float) -> Spot:
    (x, y), yaw = centre.at(station), centre.yaw_at(station)
    offset = side if forward else -side
    return x - offset * portable.sin(yaw), y + offset * portable.cos(yaw)


def _drop_repeated(points: list[Spot]) -> tuple[Spot, ...]:
    kept = [points[0]]
    for point in points[1:]:
        if portable.distance(kept[-1], point) > 0.3:
            kept.append(point)
    return tuple((round(x, 3), round(y, 3)) for x, y in kept)


@lru_cache(maxsize=256)
def find_crossing_at(roads: RoadMap, k: int, station: float) -> Crossing | None:
    """Return the way over the street from a station [m] of a pavement, at a right angle; None if there is none."""
    way = roads.footways[k]
    if not JUNCTION_M < station < way.centre.length - JUNCTION_M:
        return None
    (x, y), yaw = way.centre.at(station), way.centre.yaw_at(station)
    for sign in (1.0, -1.0):
        dx, dy = -sign * portable.sin(yaw), sign * portable.cos(yaw)
        offsets = np.arange(0.0, WIDEST_M + way.width, PROBE_M)
        points = np.column_stack((x + offsets * dx, y + offsets * dy))
        near = roads.find_nearest_lanes(points)
        on_road = shapely.contains_xy(_build_lane_area(roads), points)
        if not on_road[: round((way.width + 4.0) / PROBE_M)].any() or roads.in_junction[near.lane[on_road]].any():
            continue
        first, last = int(np.argmax(on_road)), len(on_road) - 1 - int(np.argmax(on_road[::-1]))
        if last >= len(on_road) - round(BEHIND_KERB_M / PROBE_M) - 1 or not on_road[first : last + 1].all():
            continue
        begin, end = offsets[first] - BEHIND_KERB_M, offsets[last] + BEHIND_KERB_M
        return Crossing((x + begin * dx, y + begin * dy), (x + end * dx, y + end * dy), 0.0)
    return None


def find_nearest_footway(roads: RoadMap, spot: Spot) -> tuple[int, float] | None:
    """Return index and station [m] of the pavement within 6 m of a point; None if there is none."""
    best: tuple[float, int, float] | None = None
    for k, way in enumerate(roads.footways):
        station = min(max(way.centre.project(*spot)[0], 0.0), way.centre.length)
        away = portable.distance(way.centre.at(station), spot)
        if away < 6.0 and (best is None or away < best[0]):
            best = (away, k, station)
    return None if best is None else best[1:]


def draw_side(way: Footway, rng: random.Random) -> float:
    """Return a lateral offset [m] on a pavement, more often to the right, as people walk."""
    free = max(way.width / 2 - SIDE_M, 0.0)
    return round(rng.triangular(-free, free, -free / 2), 2) if free else 0.0
