"""Ways: every lane-exact drive through a network from rim to rim, with one lane change at most."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import Lane, RoadMap

TurnDirection = Literal["straight", "left", "right", "u_turn"]
LaneChangeSide = Literal["left", "right", ""]
STRAIGHT_RAD = math.radians(35)
U_TURN_RAD = math.radians(145)
MOST_LANES = 40
"""Longer ways go in circles (roundabouts)."""


@dataclass(frozen=True, slots=True)
class LaneRoute:
    """A drive on connected lanes, in the notation of `Ego.lanes`. Lane ranks count driving lanes from the right."""

    lanes: tuple[str, ...]
    entry: str
    """Edge where it begins."""
    exit: str
    entry_rank: int
    exit_rank: int
    entry_yaw: float
    """Direction [rad] of the first lane as a whole; arms of roundabouts bend before the ring."""
    exit_yaw: float
    turn: TurnDirection
    change_side: LaneChangeSide = ""
    """To which side it changes lanes."""
    change_index: int = -1
    """Index in `lanes` of the lane that it leaves for its neighbour; -1: it changes none."""
    changes_late: bool = False
    """Whether it changes lanes behind a junction."""


@lru_cache(maxsize=32)
def find_lane_routes(roads: RoadMap) -> tuple[LaneRoute, ...]:
    """All ways without a lane change, sorted by their lanes. They end where the network ends, not where a lane does."""
    return tuple(_way(roads, chain) for chain in sorted(_complete_chains(roads)))


@lru_cache(maxsize=32)
def find_lane_change_routes(roads: RoadMap) -> tuple[LaneRoute, ...]:
    """All ways with exactly one lane change; those of an acceleration lane among them."""
    found: set[tuple[tuple[str, ...], int]] = set()
    for start in _starts(roads):
        for chain in _chains(roads, (start.id,)):
            for i, id_ in enumerate(chain):
                lane = roads.lanes[id_]
                for beside in (lane.left, lane.right):
                    if beside:
                        ends = _chains(roads, (*chain[: i + 1], beside))
                        found |= {(end, i) for end in ends if _complete(roads, end)}
    return tuple(_way(roads, chain, i) for chain, i in sorted(found))


def _complete_chains(roads: RoadMap) -> Iterator[tuple[str, ...]]:
    for start in _starts(roads):
        for chain in _chains(roads, (start.id,)):
            if _complete(roads, chain):
                yield chain


def _starts(roads: RoadMap) -> list[Lane]:
    led_to = {after for lane in roads.driving for after in lane.successors}
    return [lane for lane in roads.driving if not lane.junction and lane.id not in led_to]


def _complete(roads: RoadMap, chain: Sequence[str]) -> bool:
    """Whether a chain ends at the rim: no lane of its last edge leads on."""
    edge = roads.lanes[chain[-1]].edge
    return not any(lane.successors for lane in roads.driving if lane.edge == edge)


def _chains(roads: RoadMap, chain: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """The chain and everything that follows, no edge left and met again."""
    lane = roads.lanes[chain[-1]]
    if not lane.successors:
        yield chain
    edges = {roads.lanes[id_].edge for id_ in chain}
    for after in lane.successors:
        if roads.lanes[after].edge not in edges and len(chain) < MOST_LANES:
            yield from _chains(roads, (*chain, after))


def _way(roads: RoadMap, chain: tuple[str, ...], change_at: int = -1) -> LaneRoute:
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
        entry_yaw=_yaw_over_all(first),
        exit_yaw=_yaw_over_all(last),
        turn=_turn(roads, chain),
        change_side=side,
        change_index=change_at,
        changes_late=changes and any(roads.lanes[id_].junction for id_ in chain[:change_at]),
    )


def compute_lane_rank(roads: RoadMap, lane: Lane) -> int:
    """How many driving lanes lie to the right of a lane: SUMO's index counts pavements too."""
    rank = 0
    while lane.right:
        lane, rank = roads.lanes[lane.right], rank + 1
    return rank


def _yaw_over_all(lane: Lane) -> float:
    x, y = lane.centre.xy[-1] - lane.centre.xy[0]
    return math.atan2(y, x)


def _turn(roads: RoadMap, chain: Sequence[str]) -> TurnDirection:
    net = wrap_angle(_yaw_over_all(roads.lanes[chain[-1]]) - _yaw_over_all(roads.lanes[chain[0]]))
    steps = np.concatenate([np.diff(roads.lanes[id_].centre.xy, axis=0) for id_ in chain])
    steps = steps[np.hypot(*steps.T) > 1e-6]
    swept = float(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))).sum())
    if abs(net) > U_TURN_RAD or abs(swept) > math.pi * 1.25:
        return "u_turn"
    if abs(net) <= STRAIGHT_RAD:
        return "straight"
    return "left" if net > 0 else "right"
