"""Match sparse waypoints to a drivable lane sequence: a shortest path through all their candidate lanes.

The nearest lane alone is wrong where lanes overlap (junctions) or lead the other way. So every waypoint keeps all lanes
within `CANDIDATE_RANGE_M` as candidates, and the cheapest chain over the whole route is chosen by distance from the
lanes, driven length and lane changes. The idea is that of map matching with hidden Markov models (Newson, Krumm 2009).
"""

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.roads import Lane, RoadMap, Route, join_route_pieces

CANDIDATE_RANGE_M = 12.0
"""[m] Lanes further from a waypoint are no candidates; a waypoint without candidates is dropped and reported."""
OFF_LANE_COST = 12.0
"""Metres of driving equivalent to one metre off the centre line: a lane width outweighs two lane changes."""
LANE_CHANGE_COST_M = 10.0
"""[m] A lane change costs as much as a detour of this length."""
LATE_CHANGE_COST = 0.05
"""Extra cost of a lane change per metre driven before it: CARLA's planner changes lanes as soon as it can."""
DETOUR_M = 150.0
"""[m] Maximum excess of a path between two waypoints over the straight line."""
DROP_COST_M = 400.0
"""Cost of dropping a waypoint between the first and the last: higher than any detour."""
CHANGE_M = 5.0
"""Length of a change over one lane, if there is room: five 1 m points, as in CARLA's GlobalRoutePlanner."""
SAMPLE_M = 0.25
"""[m] Distance between the points of a path."""
END_SKEW_M = 5.0
"""[m] Longitudinal offset allowed between the ends of neighbouring lanes."""


class RoutePiece(NamedTuple):
    """A stretch of a route."""

    xy: Float
    """Points (M, 2) [m]."""
    yaw: Float
    """Directions (M,) [rad] of the lanes."""


@dataclass(frozen=True, slots=True)
class WaypointProjection:
    """Projection of a waypoint on a lane: arc length s [m] and signed offset [m], positive to the left."""

    waypoint: int
    lane: str
    s: float
    offset: float


@dataclass(frozen=True, slots=True)
class RouteLeg:
    """Path between two matched waypoints: lanes in driving order, neighbours where the lane changes."""

    lanes: tuple[str, ...]
    start_s: float
    goal_s: float


@dataclass(frozen=True, slots=True)
class WaypointMatch:
    """A matched route: projections of the kept waypoints, legs between them, indices of dropped waypoints."""

    projections: tuple[WaypointProjection, ...]
    legs: tuple[RouteLeg, ...]
    dropped: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Chain:
    cost: float
    feet: tuple[WaypointProjection, ...]
    legs: tuple[RouteLeg, ...]


def match_waypoints(roads: RoadMap, xy: Float) -> WaypointMatch:
    """Match waypoints xy (M, 2) [m] to lanes; raise InputError if less than two are near a lane or no path exists."""
    feet = [_find_candidates(roads, i, float(x), float(y)) for i, (x, y) in enumerate(xy)]
    kept = [candidates for candidates in feet if candidates]
    if len(kept) < 2:
        raise InputError(f"expected at least 2 waypoints within {CANDIDATE_RANGE_M:g} m of a lane, found {len(kept)}")
    chains = [_Chain(_compute_emission_cost(foot), (foot,), ()) for foot in kept[0]]
    for candidates in kept[1:-1]:
        without = (_Chain(chain.cost + DROP_COST_M, chain.feet, chain.legs) for chain in chains)
        chains = [*_extend_chains(roads, chains, candidates), *without]
    chains = _extend_chains(roads, chains, kept[-1])
    if not chains:
        raise InputError(f"expected a drivable way through the waypoints on network {roads.name}, found none")
    best = min(chains, key=lambda chain: chain.cost)
    used = {foot.waypoint for foot in best.feet}
    return WaypointMatch(best.feet, best.legs, tuple(i for i in range(len(xy)) if i not in used))


def _find_candidates(roads: RoadMap, waypoint: int, x: float, y: float) -> list[WaypointProjection]:
    near = roads.find_lanes_near(x, y, CANDIDATE_RANGE_M)
    return [WaypointProjection(waypoint, lane.id, *lane.centre.project(x, y)) for lane in near]


def _compute_emission_cost(foot: WaypointProjection) -> float:
    return OFF_LANE_COST * abs(foot.offset)


def _extend_chains(roads: RoadMap, chains: Sequence[_Chain], goals: Sequence[WaypointProjection]) -> list[_Chain]:
    """Return the cheapest chain to every reachable goal."""
    best: dict[str, _Chain] = {}
    for chain in chains:
        for goal, leg, cost in _find_legs(roads, chain.feet[-1], goals):
            total = chain.cost + cost + _compute_emission_cost(goal)
            if goal.lane not in best or total < best[goal.lane].cost:
                best[goal.lane] = _Chain(total, (*chain.feet, goal), (*chain.legs, leg))
    return list(best.values())


def _find_legs(
    roads: RoadMap, start: WaypointProjection, goals: Sequence[WaypointProjection]
) -> Iterable[tuple[WaypointProjection, RouteLeg, float]]:
    """Yield the legs from a projection to every reachable goal, with their cost [m]."""
    a, b = roads.lanes[start.lane].centre.at(start.s), roads.lanes[goals[0].lane].centre.at(goals[0].s)
    reached = _search(roads.lanes, start, math.dist(a, b) + DETOUR_M)
    for goal in goals:
        if goal.lane not in reached.cost:
            continue
        lanes = _backtrack(reached.came, goal.lane)
        behind = roads.lanes[start.lane].edge == roads.lanes[goal.lane].edge and goal.s <= start.s
        if not behind:
            yield goal, RouteLeg(lanes, start.s, goal.s), reached.cost[goal.lane] + goal.s


@dataclass(frozen=True, slots=True)
class _SearchResult:
    cost: Mapping[str, float]
    """Cost [m] up to the beginning of each lane; negative if that lies before the start."""
    came: Mapping[str, str]


def _search(lanes: Mapping[str, Lane], start: WaypointProjection, limit: float) -> _SearchResult:
    """Run Dijkstra's algorithm over lanes. Parallel lanes of an edge count as equally long, which they nearly are."""
    cost: dict[str, float] = {start.lane: -start.s}
    came: dict[str, str] = {}
    queue: list[tuple[float, str]] = [(-start.s, start.lane)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if so_far > cost[here]:
            continue
        for there, step in _list_successors(lanes[here], max(so_far, 0.0)):
            total = so_far + step
            if total < limit and total < cost.get(there, math.inf):
                cost[there], came[there] = total, here
                heapq.heappush(queue, (total, there))
    return _SearchResult(cost, came)


def _list_successors(lane: Lane, driven: float) -> Iterable[tuple[str, float]]:
    for successor in lane.successors:
        yield successor, lane.centre.length
    for neighbour in (lane.left, lane.right):
        if neighbour:
            yield neighbour, LANE_CHANGE_COST_M + LATE_CHANGE_COST * driven


def _backtrack(came: Mapping[str, str], goal: str) -> tuple[str, ...]:
    path = [goal]
    while path[-1] in came:
        path.append(came[path[-1]])
    return tuple(reversed(path))


@dataclass(frozen=True, slots=True)
class _LaneRun:
    """Consecutive lanes, and the number of lane changes at their beginning."""

    changes: int
    lanes: tuple[Lane, ...]


def compute_start_pose(roads: RoadMap, legs: Sequence[RouteLeg]) -> tuple[float, float, float]:
    """Return x, y [m] of the start on the centre line of the first lane, and the direction of the lane [rad]."""
    centre = roads.lanes[legs[0].lanes[0]].centre
    return (*centre.at(legs[0].start_s), centre.yaw_at(legs[0].start_s))


def build_dense_route(roads: RoadMap, legs: Sequence[RouteLeg]) -> Route:
    """Build the dense route along consecutive legs."""
    pieces = [piece for leg in legs for piece in _build_leg_pieces(roads, leg)]
    return join_route_pieces(legs[0].lanes + tuple(lane for leg in legs[1:] for lane in leg.lanes[1:]), pieces)


def _build_leg_pieces(roads: RoadMap, leg: RouteLeg) -> Iterator[RoutePiece]:
    drives = _split_at_lane_changes([roads.lanes[lane] for lane in leg.lanes])
    here = roads.lanes[leg.lanes[0]].centre.at(leg.start_s)
    for drive in drives:
        path = build_polyline(np.concatenate([lane.centre.xy for lane in drive.lanes]))
        rest = drive.lanes[-1].centre.length - leg.goal_s if drive is drives[-1] else 0.0
        start, aside = path.project(*here, between=(0.0, drive.lanes[0].centre.length + END_SKEW_M))
        end = max(path.length - rest, start)
        yield _build_lane_change(path, (start, end), aside, CHANGE_M * drive.changes)
        here = path.at(end)


def _split_at_lane_changes(lanes: Sequence[Lane]) -> list[_LaneRun]:
    """Split a leg where it changes lanes; a lane is left at its beginning."""
    drives: list[_LaneRun] = []
    changes, chain = 0, [lanes[0]]
    for before, lane in pairwise(lanes):
        if lane.id not in (before.left, before.right):
            chain.append(lane)
            continue
        if len(chain) > 1:
            drives.append(_LaneRun(changes, tuple(chain[:-1])))
            changes = 0
        changes, chain = changes + 1, [lane]
    return [*drives, _LaneRun(changes, tuple(chain))]


def _build_lane_change(path: Polyline, between: tuple[float, float], aside: float, room: float) -> RoutePiece:
    """Follow the path, from `aside` [m] (positive: left) onto it within `room` [m] with a smoothstep."""
    start, end = between
    stations = np.linspace(start, end, max(int((end - start) / SAMPLE_M), 1) + 1)
    xy = np.array([path.at(s) for s in stations])
    yaw = np.array([path.yaw_at(s) for s in stations])
    share = np.clip((stations - start) / max(min(room, end - start), 1e-6), 0.0, 1.0)
    offset = aside * (1 - share**2 * (3 - 2 * share))
    return RoutePiece(xy + offset[:, None] * np.column_stack((-np.sin(yaw), np.cos(yaw))), yaw)
