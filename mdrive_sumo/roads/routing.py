"""Lane-level routing: a drivable sequence of lanes, and the dense 1 m route along it."""

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads.road_map import Lane, RoadMap

HOP_M = 1.0
"""Spacing of a dense route (protocol section 6)."""
LANE_CHANGE_M = 20.0
"""Length over which a route moves from one lane to its neighbour, where the lane is long enough."""
LANE_CHANGE_COST_M = 30.0
"""Search cost of a lane change [m], so that routes change lanes only where necessary."""


@dataclass(frozen=True)
class Route:
    """A dense route: xy (N, 2) [m] every metre, direction of the assigned lane (N,) [rad], its lane ids in order."""

    lanes: tuple[str, ...]
    xy: Float
    yaw: Float


def find_lane_path(roads: RoadMap, start: str, goal: str) -> tuple[str, ...]:
    """Return the lane ids from start to goal with the least length plus lane-change cost. Raises InputError if none."""
    best: dict[str, float] = {start: 0.0}
    predecessor_by_lane: dict[str, str] = {}
    queue: list[tuple[float, str]] = [(0.0, start)]
    while queue:
        cost, here = heapq.heappop(queue)
        if here == goal:
            return _walk_back(predecessor_by_lane, goal)
        if cost > best[here]:
            continue
        for there, step in _find_next_lanes(roads.lanes, here):
            if cost + step < best.get(there, np.inf):
                best[there], predecessor_by_lane[there] = cost + step, here
                heapq.heappush(queue, (cost + step, there))
    raise InputError(f"network {roads.name}: expected a way from lane {start} to lane {goal}, found none")


def _find_next_lanes(lanes: Mapping[str, Lane], here: str) -> Iterable[tuple[str, float]]:
    lane = lanes[here]
    for successor in lane.successors:
        yield successor, lane.centre.length
    for neighbour in (lane.left, lane.right):
        if neighbour:
            yield neighbour, LANE_CHANGE_COST_M


def _walk_back(predecessor_by_lane: Mapping[str, str], goal: str) -> tuple[str, ...]:
    path = [goal]
    while path[-1] in predecessor_by_lane:
        path.append(predecessor_by_lane[path[-1]])
    return tuple(reversed(path))


def build_lane_route(
    roads: RoadMap,
    lanes: Sequence[str],
    start_s: float,
    goal_s: float,
    change_at: Mapping[int, float] | None = None,
    change_m: float = LANE_CHANGE_M,
) -> Route:
    """Return the dense route along connected lanes, from arc length start_s [m] on the first to goal_s [m] on the last.

    Where two consecutive lanes are neighbours the route moves over within `change_m` [m], centred on the stretch that
    both share, or begins at arc length `change_at[i]` [m] of lane i. Raises InputError for lanes that do not connect.
    """
    pieces: list[tuple[Float, Float]] = []
    begin = start_s
    for i, lane_id in enumerate(lanes):
        lane = _find_lane(roads, lane_id)
        last = i == len(lanes) - 1
        if not last and lanes[i + 1] in (lane.left, lane.right):
            neighbour = _find_lane(roads, lanes[i + 1])
            goal = neighbour.centre.at(goal_s) if i + 2 == len(lanes) else neighbour.centre.xy[-1]
            end = lane.centre.project(float(goal[0]), float(goal[1]))[0]
            leave, arrive = _compute_change_window(lane, (begin, end), (change_at or {}).get(i), change_m)
            pieces.append(_sample_lane(lane, begin, leave))
            pieces.append(_sample_lane_change(lane, neighbour, leave, arrive))
            begin = neighbour.centre.project(*lane.centre.at(arrive))[0]  # in a bend the lanes differ in length
        else:
            if not last and lanes[i + 1] not in lane.successors:
                raise InputError(
                    f"network {roads.name}: expected lane {lanes[i + 1]} to follow {lane_id}, found {lane.successors}"
                )
            pieces.append(_sample_lane(lane, begin, goal_s if last else lane.centre.length))
            begin = 0.0
    return join_route_pieces(tuple(lanes), pieces)


def _find_lane(roads: RoadMap, lane_id: str) -> Lane:
    if lane_id not in roads.lanes:
        raise InputError(f"network {roads.name}: expected a lane for cars, found {lane_id!r}")
    return roads.lanes[lane_id]


def _compute_change_window(
    lane: Lane, shared: tuple[float, float], wanted: float | None, change_m: float
) -> tuple[float, float]:
    begin, end = shared
    room = max(end - begin, 0.0)
    length = min(change_m, room)
    leave = begin + (room - length) / 2 if wanted is None else min(max(wanted, begin), end - length)
    if length < 1.0:
        raise InputError(f"lane {lane.id}: expected at least 1 m to change lanes in, found {room:.1f} m")
    return leave, leave + length


def _sample_lane(lane: Lane, begin: float, end: float) -> tuple[Float, Float]:
    """Return points (M, 2) [m] and directions (M,) [rad] about every 0.25 m of a lane between two arc lengths."""
    stations = np.linspace(begin, end, max(int((end - begin) / 0.25), 1) + 1)
    return np.array([lane.centre.at(s) for s in stations]), np.array([lane.centre.yaw_at(s) for s in stations])


def _sample_lane_change(lane: Lane, neighbour: Lane, leave: float, arrive: float) -> tuple[Float, Float]:
    """As `_sample_lane`, moving over to the neighbour along a smoothstep; the direction stays the lanes' own."""
    before, yaw = _sample_lane(lane, leave, arrive)
    after = np.array([neighbour.centre.at(neighbour.centre.project(x, y)[0]) for x, y in before])
    share = np.linspace(0.0, 1.0, len(before))[:, None]
    weight = (share * share) * (3 - 2 * share)
    return before * (1 - weight) + after * weight, yaw


def join_route_pieces(lanes: tuple[str, ...], pieces: Sequence[tuple[Float, Float]]) -> Route:
    """Return the dense route through finely sampled pieces: points (M, 2) [m] and lane directions (M,) [rad] each."""
    xy = np.concatenate([points for points, _ in pieces])
    yaw = np.unwrap(np.concatenate([directions for _, directions in pieces]))
    keep = np.concatenate(((True,), portable.hypot(*np.diff(xy, axis=0).T) > 1e-6))
    line = Polyline(xy[keep])
    return Route(lanes, line.resample(HOP_M).xy, np.interp(line.stations(HOP_M), line.s, yaw[keep]))
