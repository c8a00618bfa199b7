"""Separate overlapping start boxes along their routes by the smallest total distance."""

import heapq
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners, boxes_overlap
from mdrive_sumo.roads import RoadMap
from real2sim.match.dense_route import build_dense_route, compute_start_pose
from real2sim.match.waypoint_matcher import RouteLeg

CAR_LENGTH_M = 4.90
CAR_WIDTH_M = 2.00
GAP_M = 0.02
"""[m] Kept between boxes, so that rounding poses to 1 mm cannot bring them into contact."""
STEP_M = 0.1
MAX_SHIFT_M = 20.0

RouteLegs = tuple[RouteLeg, ...]


def separate_starts(roads: RoadMap, routes: Sequence[RouteLegs]) -> tuple[float, ...]:
    """Return how far each start moves forward [m], in steps of `STEP_M`, with the smallest sum; raise InputError.

    Uniform-cost search over the shifts: of two overlapping boxes, one moves on until it is clear of the other. Sharing
    the distance between both is never shorter, because a separating axis is reached soonest by the box that is faster
    along it.
    """

    @cache
    def box(cav: int, steps: int) -> Float:
        return _compute_box(roads, routes[cav], steps)

    @cache
    def limit(cav: int) -> int:
        return _count_possible_steps(roads, routes[cav])

    queue: list[tuple[int, tuple[int, ...]]] = [(0, (0,) * len(routes))]
    seen: set[tuple[int, ...]] = set()
    while queue:
        total, steps = heapq.heappop(queue)
        if steps in seen:
            continue
        seen.add(steps)
        pair = _find_first_overlap([box(i, n) for i, n in enumerate(steps)])
        if pair is None:
            return tuple(round(n * STEP_M, 3) for n in steps)
        for mover, other in (pair, pair[::-1]):
            further = range(steps[mover] + 1, limit(mover) + 1)
            clear = (n for n in further if not boxes_overlap(box(mover, n), box(other, steps[other])))
            if (n := next(clear, None)) is not None:
                heapq.heappush(queue, (total + n - steps[mover], (*steps[:mover], n, *steps[mover + 1 :])))
    raise InputError(f"expected starts that can be moved apart by up to {MAX_SHIFT_M:g} m, found none")


def advance_start(roads: RoadMap, legs: RouteLegs, distance: float) -> RouteLegs:
    """Return the legs without their first `distance` metres; raise InputError if they are shorter."""
    if not legs:
        raise InputError("expected a route long enough to move its start, found its end")
    first, rest = legs[0], legs[1:]
    lane = roads.lanes[first.lanes[0]]
    alone = len(first.lanes) == 1
    room = (first.goal_s if alone else lane.centre.length) - first.start_s
    if distance < room:
        return (replace(first, start_s=first.start_s + distance), *rest)
    if alone:
        return advance_start(roads, rest, distance - room)
    entry = roads.lanes[first.lanes[1]]
    begin = 0.0 if entry.id in lane.successors else entry.centre.project(*lane.centre.at(lane.centre.length))[0]
    return advance_start(roads, (RouteLeg(first.lanes[1:], begin, first.goal_s), *rest), distance - room)


def _compute_box(roads: RoadMap, legs: RouteLegs, steps: int) -> Float:
    pose = compute_start_pose(roads, advance_start(roads, legs, steps * STEP_M))
    return box_corners(*pose, CAR_LENGTH_M + GAP_M, CAR_WIDTH_M + GAP_M)


def _count_possible_steps(roads: RoadMap, legs: RouteLegs) -> int:
    """Return the number of steps that leave at least 2 m of the route."""
    length = float(np.hypot(*np.diff(build_dense_route(roads, legs).xy, axis=0).T).sum())
    return max(int((min(length - 2.0, MAX_SHIFT_M)) / STEP_M), 0)


def _find_first_overlap(boxes: Sequence[Float]) -> tuple[int, int] | None:
    pairs = combinations(range(len(boxes)), 2)
    return next(((i, j) for i, j in pairs if boxes_overlap(boxes[i], boxes[j])), None)
