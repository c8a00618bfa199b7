"""Match points that a person has clicked to places on lanes, such that a short way leads through all of them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import Lane, RoadMap, find_lane_path
from mdrive_sumo.roads.routing import LANE_CHANGE_COST_M

BESIDE_LANE_M = 2.0
"""[m] How far beyond the edge of a lane a point may lie: a hand misses by that on a map of a town."""
MAX_CANDIDATES = 8
"""Lanes that a point may stand for: more do not cross at one point of the networks at hand."""
ASIDE_COST = 4.0
"""[m of way per m] A point off the centre line is worth that much of a detour: half a lane, 7 m."""


class Spot(NamedTuple):
    """A place on a lane: lane id and arc length [m]."""

    lane: str
    s: float


def match_points(roads: RoadMap, wanted: Sequence[Spot | tuple[float, float]]) -> tuple[Spot, ...]:
    """Return a spot for every wanted one, points (x, y) [m] included, with the shortest way through all of them.

    Raises InputError for a point off the road and if no way leads from one to the next.
    """
    candidates = [_list_candidates(roads, i, len(wanted), place) for i, place in enumerate(wanted)]
    best = [(cost, (spot,)) for spot, cost in candidates[0]]
    for i in range(1, len(candidates)):
        extended: list[tuple[float, tuple[Spot, ...]]] = []
        for spot, aside in candidates[i]:
            ways = [
                (cost + aside + length, (*way, spot))
                for cost, way in best
                if (length := measure_way(roads, way[-1], spot)) is not None
            ]
            if ways:
                extended.append(min(ways))
        if not extended:
            raise InputError(
                f"route: expected a way from {_describe_place(wanted[i - 1])} to {_describe_place(wanted[i])},"
                f" found none in network {roads.name}"
            )
        best = extended
    return min(best)[1]


def match_point(roads: RoadMap, point: tuple[float, float]) -> Spot:
    """Return the spot nearest to a point (x, y) [m], on lanes outside junctions if there is one. Raises InputError."""
    candidates = _list_candidates(roads, 0, 1, point)
    return min(candidates, key=lambda candidate: (roads.lanes[candidate[0].lane].junction, candidate[1]))[0]


def _describe_place(place: Spot | tuple[float, float]) -> str:
    if isinstance(place, Spot):
        return f"lane {place.lane}"
    x, y = place
    return f"({x:.1f}, {y:.1f})"


def _list_candidates(
    roads: RoadMap, number: int, count: int, place: Spot | tuple[float, float]
) -> list[tuple[Spot, float]]:
    """Return spots with what each costs [m of way]."""
    if isinstance(place, Spot):
        return [(place, 0.0)]
    x, y = place
    reach = float(roads.lane_width.max()) / 2 + BESIDE_LANE_M
    spots: list[tuple[Spot, float]] = []
    for lane in roads.find_lanes_near(x, y, reach):
        s, aside = lane.centre.project(x, y)
        if abs(aside) <= lane.width / 2 + BESIDE_LANE_M and -1.0 <= s <= lane.centre.length + 1.0:
            spots.append((Spot(lane.id, min(max(s, 0.0), lane.centre.length)), ASIDE_COST * abs(aside)))
    if not spots:
        raise InputError(_describe_off_road(roads, number, count, place))
    return sorted(spots, key=lambda spot: spot[1])[:MAX_CANDIDATES]


def _describe_off_road(roads: RoadMap, number: int, count: int, place: tuple[float, float]) -> str:
    x, y = place
    name = "start" if number == 0 else "goal" if number == count - 1 else f"step {number + 1}"
    lane, gap = find_nearest_lane(roads, place)
    return (
        f"route: {name} ({x:.1f}, {y:.1f}): expected a place on the road, found the nearest lane, {lane.id},"
        f" {gap:.1f} m away"
    )


def find_nearest_lane(roads: RoadMap, point: tuple[float, float]) -> tuple[Lane, float]:
    """Return the lane with the centre line nearest to a point (x, y) [m], and its distance [m]."""
    near = roads.find_nearest_lanes(np.array([point]))
    return roads.driving[int(near.lane[0])], float(near.distance[0])


def measure_way(roads: RoadMap, here: Spot, there: Spot) -> float | None:
    """Return the length [m] of the way from one spot to another, lane changes priced as routing does; None: no way."""
    if here.lane == there.lane:
        return there.s - here.s if there.s > here.s else None
    try:
        path = find_lane_path(roads, here.lane, there.lane)
    except InputError:
        return None
    length, changes = there.s - here.s, 0
    for before, after in pairwise(path):
        lane = roads.lanes[before]
        if after in (lane.left, lane.right):
            changes += 1
        else:
            length += lane.centre.length
    return length + changes * LANE_CHANGE_COST_M if length > 0.0 else None
