"""Topology and features of a network, derived from its lane routes."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import combinations

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.lane_routes import LaneRoute, are_opposite, find_lane_change_routes, find_lane_routes

HIGHWAY_MPS = 16.0
"""[m/s] Roads with a higher speed limit and one direction of travel are highways."""


class Topology(StrEnum):
    """Shapes of road that a proposal may ask for (protocol 14.1)."""

    INTERSECTION = "intersection"
    T_JUNCTION = "t_junction"
    CORRIDOR = "corridor"
    TWO_LANE_CORRIDOR = "two_lane_corridor"
    HIGHWAY = "highway"
    ROUNDABOUT = "roundabout"


@dataclass(frozen=True, slots=True)
class NetworkFeatures:
    """Topology and features of a network."""

    network: str
    topology: Topology
    oncoming: bool
    multi_lane: bool
    on_ramp: bool
    merge: bool


@lru_cache(maxsize=64)
def extract_features(roads: RoadMap) -> NetworkFeatures:
    """Return topology and features of a network, derived from its lane routes."""
    ways = find_lane_routes(roads)
    entries = {way.entry: way for way in (*ways, *find_lane_change_routes(roads))}
    oncoming = any(are_opposite(one, other) for one, other in combinations(entries.values(), 2))
    merge = any(_do_merge(one, other) for one, other in combinations(ways, 2))
    multi_lane = any(way.entry_rank > 0 for way in ways)
    fast = not oncoming and max(lane.speed_limit for lane in roads.driving) > HIGHWAY_MPS
    topology = _classify_topology(ways, len(entries), fast)
    on_ramp = topology is Topology.HIGHWAY and len(entries) > 1
    return NetworkFeatures(roads.name, topology, oncoming, multi_lane, on_ramp, merge or on_ramp)


def _classify_topology(ways: Iterable[LaneRoute], entries: int, fast: bool) -> Topology:
    if fast:
        return Topology.HIGHWAY
    if any(way.turn == "u_turn" for way in ways):
        return Topology.ROUNDABOUT
    if entries > 2:
        return Topology.T_JUNCTION if entries == 3 else Topology.INTERSECTION
    return Topology.CORRIDOR if any(way.entry_rank > 0 for way in ways) else Topology.TWO_LANE_CORRIDOR


def _do_merge(one: LaneRoute, other: LaneRoute) -> bool:
    differs = one.lanes[0] != other.lanes[0]
    return differs and one.lanes[-1] == other.lanes[-1]
