"""Which packaged networks a proposal may use: those that meet its requirements and serve no other purpose."""

from collections.abc import Iterable

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.roads import RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.worlds.network_features import NetworkFeatures, extract_features

HARD_TIER_PREFIX = "hard_"
"""Names of networks of the hard tier begin so; the other suites' proposals use none of them."""


def is_hard_tier(network: str) -> bool:
    """Return whether a packaged network belongs to the hard tier only."""
    return network.startswith(HARD_TIER_PREFIX)


def find_networks(proposal: Proposal, names: Iterable[str] = ()) -> tuple[RoadMap, ...]:
    """Return the networks that meet the proposal's requirements: of those named, else of all packaged ones but the hard
    tier's. Raises InputError if there is none."""
    folders = list_packaged_networks()
    chosen = names or [name for name in folders if not is_hard_tier(name)]
    maps = [load_road_map(folders[name]) for name in sorted(chosen)]
    fitting = tuple(roads for roads in maps if is_suitable(extract_features(roads), proposal))
    if not fitting:
        needs = [name for name in ("oncoming", "multi_lane", "on_ramp", "merge") if getattr(proposal, f"needs_{name}")]
        asked = " with ".join((proposal.topology, *(", ".join(needs),) * bool(needs)))
        raise InputError(f"networks: expected one with the topology {asked}, found none among {len(maps)}")
    return fitting


def is_suitable(offer: NetworkFeatures, proposal: Proposal) -> bool:
    """Return whether a network has the topology and all features that a proposal needs."""
    asked = ((proposal.needs_oncoming, offer.oncoming), (proposal.needs_multi_lane, offer.multi_lane))
    ramps = ((proposal.needs_on_ramp, offer.on_ramp), (proposal.needs_merge, offer.merge))
    return offer.topology is proposal.topology and all(has or not need for need, has in (*asked, *ramps))
