"""Ways of background vehicles through a network: chains of connected lanes, drawn by turning shares."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import Lane, RoadMap

STRAIGHT_RAD, U_TURN_RAD = math.radians(35), math.radians(145)
"""As `lane_routes` classifies turns."""
LONGEST_M = 1500.0
"""[m] A way ends after this: a vehicle at 50 km/h drives it in 108 s, longer than an episode."""


def classify_turn(roads: RoadMap, lane: Lane, following: Lane) -> str:
    """Return "straight", "left", "right" or "u_turn" for the way from the end of a lane to what follows it.

    A junction lane turns by the angle between its ends; a road lane that follows directly is straight on.
    """
    if not following.junction:
        return "straight"
    last = following
    while last.junction and last.successors:  # lanes inside a junction may have several parts
        last = roads.lanes[last.successors[0]]
    angle = wrap_angle(last.centre.yaw_at(0.0) - lane.centre.yaw_at(lane.centre.length))
    if abs(angle) > U_TURN_RAD:
        return "u_turn"
    return "straight" if abs(angle) <= STRAIGHT_RAD else "left" if angle > 0 else "right"


@lru_cache(maxsize=32)
def find_turns(roads: RoadMap) -> Mapping[str, tuple[tuple[str, str], ...]]:
    """Return (successor lane, turn) of every lane by its id."""
    return {
        lane.id: tuple((id_, classify_turn(roads, lane, roads.lanes[id_])) for id_ in lane.successors)
        for lane in roads.driving
    }


def draw_lane_chain(
    roads: RoadMap, first: str, turn_shares: Mapping[str, float], rng: random.Random
) -> tuple[str, ...]:
    """Return lanes from `first` to the end of the network, or `LONGEST_M` far.

    At every junction the way is drawn by the shares of the turns that the lane allows. Where a lane ends and its edge
    does not, the way goes on from the lane beside it. U-turns are made where nothing else is possible.
    """
    turns = find_turns(roads)
    passed, edges, length = [first], {roads.lanes[first].edge}, roads.lanes[first].centre.length
    while length < LONGEST_M:
        lane = roads.lanes[passed[-1]]
        onward = [(id_, turn) for id_, turn in turns[lane.id] if roads.lanes[id_].edge not in edges]
        if not onward and not lane.successors:
            beside = [
                id_ for id_ in (lane.left, lane.right) if id_ and id_ not in passed and roads.lanes[id_].successors
            ]
            if not beside:
                break
            passed.append(beside[0])
            continue
        if not onward:
            break
        weights = [turn_shares.get(turn, 0.0) if len(onward) > 1 else 1.0 for _, turn in onward]
        chosen = rng.choices([id_ for id_, _ in onward], weights if sum(weights) > 0 else None)[0]
        passed.append(chosen)
        edges.add(roads.lanes[chosen].edge)
        length += roads.lanes[chosen].centre.length
    return tuple(passed)


def list_edges(roads: RoadMap, lanes: Sequence[str]) -> tuple[str, ...]:
    """Return the edges of a chain of lanes in driving order, without those inside junctions."""
    edges = [roads.lanes[id_].edge for id_ in lanes if not roads.lanes[id_].junction]
    return tuple(edge for k, edge in enumerate(edges) if k == 0 or edge != edges[k - 1])


def changes_lanes(roads: RoadMap, lanes: Sequence[str]) -> bool:
    """Return whether a chain of lanes goes on from a lane beside another one."""
    return any(after in (roads.lanes[here].left, roads.lanes[here].right) for here, after in pairwise(lanes))


class Way(NamedTuple):
    """A way through a network: its edges, and whether its lanes lead along them without a lane change."""

    edges: tuple[str, ...]
    keeps_lane: bool


def draw_way(roads: RoadMap, first: str, turn_shares: Mapping[str, float], rng: random.Random) -> Way:
    """Return the way of a vehicle that departs on a lane, see `draw_lane_chain`."""
    lanes = draw_lane_chain(roads, first, turn_shares, rng)
    return Way(list_edges(roads, lanes), not changes_lanes(roads, lanes))


@lru_cache(maxsize=32)
def find_predecessors(roads: RoadMap) -> Mapping[str, tuple[str, ...]]:
    """Return the ids of the lanes that lead to each lane, by its id."""
    before: dict[str, list[str]] = {lane.id: [] for lane in roads.driving}
    for lane in roads.driving:
        for after in lane.successors:
            before[after].append(lane.id)
    return {id_: tuple(sorted(lanes)) for id_, lanes in before.items()}


@lru_cache(maxsize=32)
def find_entries(roads: RoadMap) -> tuple[str, ...]:
    """Return the ids of the road lanes that nothing leads to, sorted: where traffic enters the network."""
    return tuple(
        id_ for id_, before in sorted(find_predecessors(roads).items()) if not before and not roads.lanes[id_].junction
    )


def walk_upstream(roads: RoadMap, lane: str, station: float, distance: float) -> Iterator[tuple[str, float, float]]:
    """Return (lane, from, to) [m]: all stretches from which a vehicle reaches a station within `distance` [m]."""
    before = find_predecessors(roads)
    ahead: list[tuple[str, float, float]] = [(lane, station, distance)]
    seen: set[str] = set()
    while ahead:
        id_, end, left = ahead.pop()
        if id_ in seen:
            continue
        seen.add(id_)
        yield id_, max(end - left, 0.0), end
        if left > end:
            ahead.extend((one, roads.lanes[one].centre.length, left - end) for one in before[id_])
