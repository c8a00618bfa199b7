"""Ways of background vehicles through a network: chains of connected lanes, drawn by turning shares."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import wrap_angle, wrap_angles
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.worlds.placement.background_vehicles import list_edges

STRAIGHT_RAD, U_TURN_RAD = math.radians(35), math.radians(145)
"""As `lane_routes` classifies turns."""
LARGE_LANE_M = 3.0
"""[m] Least width of a lane for trucks and buses: RASt 06 builds carriageways for buses of lanes of 3.0 m or more."""
LARGE_M, BEND_RAD = 12.0, 0.2
"""[m], [rad] A bus of 12 m on a bend that turns by 0.2 rad along it (a radius of 60 m) cuts the corner by 0.3 m, which
is what a lane of 3.2 m leaves beside it."""
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


def changes_lanes(roads: RoadMap, lanes: Sequence[str]) -> bool:
    """Return whether a chain of lanes goes on from a lane beside another one."""
    return any(after in (roads.lanes[here].left, roads.lanes[here].right) for here, after in pairwise(lanes))


class Way(NamedTuple):
    """A way through a network."""

    edges: tuple[str, ...]
    keeps_lane: bool
    """Whether its lanes lead along the edges without a lane change."""
    fits_large: bool
    """Whether trucks and buses stay on its lanes: none is narrow or bent."""


def draw_way(roads: RoadMap, first: str, turn_shares: Mapping[str, float], rng: random.Random) -> Way:
    """Return the way of a vehicle that departs on a lane, see `draw_lane_chain`."""
    lanes = draw_lane_chain(roads, first, turn_shares, rng)
    fits = _find_fitting(roads)
    return Way(list_edges(roads, lanes), not changes_lanes(roads, lanes), fits.issuperset(lanes))


@lru_cache(maxsize=32)
def _find_fitting(roads: RoadMap) -> frozenset[str]:
    """Return the lanes on which trucks and buses stay, and all lanes inside junctions, which are wide."""
    return frozenset(
        lane.id for lane in roads.driving if lane.junction or (lane.width >= LARGE_LANE_M and not _is_bent(lane))
    )


def _is_bent(lane: Lane) -> bool:
    """Return whether a long vehicle would leave a lane at the inside of a bend."""
    stations = np.arange(0.0, max(lane.centre.length - LARGE_M, 0.0) + 1.0, 4.0)
    turned = wrap_angles(lane.centre.yaws_at(stations + LARGE_M) - lane.centre.yaws_at(stations))
    return bool(np.abs(turned).max() > BEND_RAD)


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
