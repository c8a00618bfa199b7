"""Features of networks, and which networks fit a proposal. Every packaged network is one crop of a map."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.category_requirements import Topology
from mdrive_sumo.generate.lane_routes import LaneRoute, find_lane_change_routes, find_lane_routes
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.roads import RoadMap, list_packaged_networks, load_road_map

HIGHWAY_MPS = 16.0
"""[m/s] Roads with a higher speed limit and one direction of travel are highways."""
HARD_TIER_PREFIX, TRAINING_PREFIX = "hard_", "train_"
"""Names of networks of the hard tier and of those for training begin so; the other suites' proposals use neither."""
OPPOSITE_RAD = math.radians(135)


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


def are_opposite(one: LaneRoute, other: LaneRoute) -> bool:
    """Return whether two routes come from opposite directions."""
    return abs(wrap_angle(one.entry_yaw - other.entry_yaw)) > OPPOSITE_RAD


def _do_merge(one: LaneRoute, other: LaneRoute) -> bool:
    differs = one.lanes[0] != other.lanes[0]
    return differs and one.lanes[-1] == other.lanes[-1]


def is_hard_tier(network: str) -> bool:
    """Return whether a packaged network belongs to the hard tier only."""
    return network.startswith(HARD_TIER_PREFIX)


def is_for_training(network: str) -> bool:
    """Return whether a packaged network serves training only."""
    return network.startswith(TRAINING_PREFIX)


def find_networks(proposal: Proposal, names: Iterable[str] = ()) -> tuple[RoadMap, ...]:
    """Return the networks that meet the proposal's requirements: of those named, else of all packaged ones but the hard
    tier's and those for training. Raises InputError if there is none."""
    folders = list_packaged_networks()
    chosen = names or [name for name in folders if not (is_hard_tier(name) or is_for_training(name))]
    maps = [load_road_map(folders[name]) for name in sorted(chosen)]
    fitting = tuple(roads for roads in maps if _is_suitable(extract_features(roads), proposal))
    if not fitting:
        needs = [name for name in ("oncoming", "multi_lane", "on_ramp", "merge") if getattr(proposal, f"needs_{name}")]
        asked = " with ".join((proposal.topology, *(", ".join(needs),) * bool(needs)))
        raise InputError(f"networks: expected one with the topology {asked}, found none among {len(maps)}")
    return fitting


def _is_suitable(offer: NetworkFeatures, proposal: Proposal) -> bool:
    asked = ((proposal.needs_oncoming, offer.oncoming), (proposal.needs_multi_lane, offer.multi_lane))
    ramps = ((proposal.needs_on_ramp, offer.on_ramp), (proposal.needs_merge, offer.merge))
    return offer.topology is proposal.topology and all(has or not need for need, has in (*asked, *ramps))
