"""Lane-level routes: every connected sequence of lanes through a network from boundary to boundary, with at most one
lane change."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import Lane, RoadMap

TurnDirection = Literal["straight", "left", "right", "u_turn"]
LaneChangeSide = Literal["left", "right", ""]
STRAIGHT_RAD = math.radians(35)
"""[rad] Smaller changes of heading are ways straight on; chosen."""
U_TURN_RAD = math.radians(145)
"""[rad] Larger changes of heading are U-turns; chosen."""
MAX_LANES = 40
"""Longer routes go in circles (roundabouts)."""
MOST_STEPS = 200_000
"""The search takes up to 3 600 steps on packaged networks and drawn places; this many take some seconds."""
OPPOSITE_RAD = math.radians(135)
"""[rad] Roads whose headings differ by more are opposite each other: nearer to it than to a crossing road (90 deg)."""


@dataclass(frozen=True, slots=True)
class LaneRoute:
    """A route on connected lanes, in the notation of `Ego.lanes`. Lane ranks count driving lanes from the right."""

    lanes: tuple[str, ...]
    entry: str
    """Edge where the route begins."""
    exit: str
    entry_rank: int
    exit_rank: int
    entry_yaw: float
    """Direction [rad] from the first to the last point of the first lane; arms of roundabouts bend before the ring."""
    exit_yaw: float
    turn: TurnDirection
    change_side: LaneChangeSide = ""
    """Side of the lane change; "" without one."""
    change_index: int = -1
    """Index in `lanes` of the lane that the route leaves for its neighbour; -1 without a lane change."""
    changes_late: bool = False
    """Whether the lane change is behind a junction."""


@lru_cache(maxsize=32)
def find_lane_routes(roads: RoadMap) -> tuple[LaneRoute, ...]:
    """Return all routes without a lane change, sorted by their lanes. They end where the network ends, not where a lane
    does. Raises InputError for a network that is too large."""
    return tuple(_build_route(roads, chain) for chain in sorted(_find_complete_chains(roads)))


@lru_cache(maxsize=32)
def find_lane_change_routes(roads: RoadMap) -> tuple[LaneRoute, ...]:
    """Return all routes with exactly one lane change, including those from an acceleration lane."""
    found: set[tuple[tuple[str, ...], int]] = set()
    steps = iter(range(MOST_STEPS))
    for start in _find_start_lanes(roads):
        for chain in _extend_chain(roads, (start.id,), steps):
            for i, id_ in enumerate(chain):
                lane = roads.lanes[id_]
                for beside in (lane.left, lane.right):
                    if beside:
                        ends = _extend_chain(roads, (*chain[: i + 1], beside), steps)
                        found |= {(end, i) for end in ends if _is_complete(roads, end)}
    return tuple(_build_route(roads, chain, i) for chain, i in sorted(found))


def _find_complete_chains(roads: RoadMap) -> Iterator[tuple[str, ...]]:
    steps = iter(range(MOST_STEPS))
    for start in _find_start_lanes(roads):
        for chain in _extend_chain(roads, (start.id,), steps):
            if _is_complete(roads, chain):
                yield chain


def _find_start_lanes(roads: RoadMap) -> list[Lane]:
    led_to = {after for lane in roads.driving for after in lane.successors}
    return [lane for lane in roads.driving if not lane.junction and lane.id not in led_to]


def _is_complete(roads: RoadMap, chain: Sequence[str]) -> bool:
    """Return whether a chain ends at the boundary: no lane of its last edge has a successor."""
    edge = roads.lanes[chain[-1]].edge
    return not any(lane.successors for lane in roads.driving if lane.edge == edge)


def _extend_chain(roads: RoadMap, chain: tuple[str, ...], steps: Iterator[int]) -> Iterator[tuple[str, ...]]:
    """Return the chain with every possible continuation; no edge is entered twice.

    Raises InputError when `steps` are used up: the number of routes through a large network has no bound.
    """
    if next(steps, None) is None:
        raise InputError(
            f"network {roads.name}: expected a part of a town with few routes from boundary to boundary, found more"
            f" than {MOST_STEPS} steps to search them; cut out a smaller part"
        )
    lane = roads.lanes[chain[-1]]
    if not lane.successors:
        yield chain
    edges = {roads.lanes[id_].edge for id_ in chain}
    for after in lane.successors:
        if roads.lanes[after].edge not in edges and len(chain) < MAX_LANES:
            yield from _extend_chain(roads, (*chain, after), steps)


def _build_route(roads: RoadMap, chain: tuple[str, ...], change_at: int = -1) -> LaneRoute:
    first, last = roads.lanes[chain[0]], roads.lanes[chain[-1]]
    changes = change_at >= 0
    side: LaneChangeSide = (
        "" if not changes else "left" if roads.lanes[chain[change_at]].left == chain[change_at + 1] else "right"
    )
    return LaneRoute(
        lanes=chain,
        entry=first.edge,
        exit=last.edge,
        entry_rank=compute_lane_rank(roads, first),
        exit_rank=compute_lane_rank(roads, last),
        entry_yaw=_chord_yaw(first),
        exit_yaw=_chord_yaw(last),
        turn=_classify_turn(roads, chain),
        change_side=side,
        change_index=change_at,
        changes_late=changes and any(roads.lanes[id_].junction for id_ in chain[:change_at]),
    )


def are_opposite(one: LaneRoute, other: LaneRoute) -> bool:
    """Return whether two routes come from opposite directions."""
    return abs(wrap_angle(one.entry_yaw - other.entry_yaw)) > OPPOSITE_RAD


def locate_junction(roads: RoadMap, way: LaneRoute) -> tuple[float, float]:
    """Return the stations [m] of begin and end of the first junction on a route; without one, of its middle."""
    begin, found = 0.0, None
    for id_ in way.lanes:
        lane = roads.lanes[id_]
        if lane.junction:
            found = (found[0] if found else begin, begin + lane.centre.length)
        elif found:
            return found
        begin += lane.centre.length
    return found or (begin / 2, begin / 2)


def compute_lane_rank(roads: RoadMap, lane: Lane) -> int:
    """Return the number of driving lanes to the right of a lane; SUMO's index counts pavements too."""
    rank = 0
    while lane.right:
        lane, rank = roads.lanes[lane.right], rank + 1
    return rank


def _chord_yaw(lane: Lane) -> float:
    x, y = lane.centre.xy[-1] - lane.centre.xy[0]
    return portable.atan2(y, x)


def _classify_turn(roads: RoadMap, chain: Sequence[str]) -> TurnDirection:
    net = wrap_angle(_chord_yaw(roads.lanes[chain[-1]]) - _chord_yaw(roads.lanes[chain[0]]))
    steps = np.concatenate([np.diff(roads.lanes[id_].centre.xy, axis=0) for id_ in chain])
    steps = steps[portable.hypot(*steps.T) > 1e-6]
    swept = float(np.diff(np.unwrap(portable.atan2(steps[:, 1], steps[:, 0]))).sum())
    if abs(net) > U_TURN_RAD or abs(swept) > math.pi * 1.25:
        return "u_turn"
    if abs(net) <= STRAIGHT_RAD:
        return "straight"
    return "left" if net > 0 else "right"
