"""Find lane segments that lie side by side in the same direction, and segments that cross each other."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int
from real2sim.network.lane_segment import LaneSegment, compute_yaw_difference
from real2sim.polylines import PolylineIndex, compute_angles_between, sample_polylines

NEIGHBOUR_OFFSET_M = (1.8, 5.5)
"""Lateral distance [m] between the centre lines of neighbours."""
PARALLEL_RAD = np.radians(20)
"""Neighbours differ by less in direction."""
STEADY_M = 1.5
"""[m] Variation allowed in the distance between neighbours: beyond it they diverge."""
MIN_SHARED_M = 8.0
"""[m] Minimum length of a stretch side by side."""
SAMPLE_SPACING_M = 2.0
"""[m] Distance between the points at which lanes are compared."""
CROSSING_RAD = np.radians(12)
"""Lines that meet at a smaller angle merge or part."""
CROSSING_INSIDE_M = 1.5
"""[m] Lines that touch closer than this to the ends of both do not cross."""


@dataclass(frozen=True)
class LaneAdjacency:
    """Segment `other` lies beside `segment` from arc length `begin` to `end` [m] of the latter."""

    segment: str
    other: str
    begin: float
    end: float
    offset: float
    """Mean signed distance [m]; positive: `other` lies to the left."""


def find_adjacencies(segments: Mapping[str, LaneSegment]) -> list[LaneAdjacency]:
    """Return all ordered pairs of adjacent segments."""
    values = list(segments.values())
    if not values:
        return []
    lines = [segment.centreline for segment in values]
    points = sample_polylines(lines, SAMPLE_SPACING_M)
    feet = PolylineIndex(lines).project_points(points.xy, NEIGHBOUR_OFFSET_M[1])
    owner = points.line[feet.point]
    good = (owner != feet.line) & (np.abs(feet.lateral) >= NEIGHBOUR_OFFSET_M[0]) & (np.abs(feet.longitudinal) <= 1.0)
    good &= compute_angles_between(feet.yaw, points.yaw[feet.point]) <= PARALLEL_RAD
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((feet.point[rows], feet.line[rows], owner[rows]))]
    bounds = np.flatnonzero(np.diff(owner[rows]) | np.diff(feet.line[rows])) + 1
    adjacencies: list[LaneAdjacency] = []
    for pair in np.split(rows, bounds) if len(rows) else ():
        segment, other = values[owner[pair[0]]], values[feet.line[pair[0]]]
        numbers = feet.point[pair]
        if (
            adjacency := _find_steady_stretch(segment, other, points.s[numbers], numbers, feet.lateral[pair])
        ) is not None:
            adjacencies.append(adjacency)
    return adjacencies


def _find_steady_stretch(
    segment: LaneSegment, other: LaneSegment, stations: Float, number: Int, offset: Float
) -> LaneAdjacency | None:
    """Return the longest stretch of consecutive points with a steady offset, if it is long enough."""
    shortest = min(MIN_SHARED_M, 0.6 * segment.centreline.length)
    middle = float(np.median(offset))
    steady = np.flatnonzero(np.abs(offset - middle) <= STEADY_M)
    if not len(steady):
        return None
    runs = np.split(steady, np.flatnonzero(np.diff(number[steady]) > 1) + 1)
    run = max(runs, key=len)
    begin, end = float(stations[run[0]]), float(stations[run[-1]])
    return None if end - begin < shortest else LaneAdjacency(segment.id, other.id, begin, end, middle)


def find_crossings(segments: Mapping[str, LaneSegment]) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """Return pairs (ordered by id) whose centre lines cross, with the arc lengths [m] of the crossings on both."""
    values = sorted(segments.values(), key=lambda segment: segment.id)
    lines = PolylineIndex([segment.centreline for segment in values])
    drawn = lines.geometries
    crossings: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for i, j in zip(*lines.tree.query(drawn, predicate="intersects"), strict=True):
        if i >= j:
            continue
        for point in shapely.get_parts(shapely.intersection(drawn[i], drawn[j])):
            stations = tuple(float(shapely.line_locate_point(drawn[k], shapely.centroid(point))) for k in (i, j))
            if _is_real_crossing(values[i], values[j], stations[0], stations[1]):
                crossings[values[i].id, values[j].id].append((stations[0], stations[1]))
    return dict(crossings)


def _is_real_crossing(first: LaneSegment, second: LaneSegment, a: float, b: float) -> bool:
    inner = (min(a, first.centreline.length - a), min(b, second.centreline.length - b))
    turn = compute_yaw_difference(first.centreline.yaw_at(a), second.centreline.yaw_at(b))
    return min(inner) > CROSSING_INSIDE_M / 3 and max(inner) > CROSSING_INSIDE_M and turn > CROSSING_RAD
