"""Distance between two scenarios over topology, conflict geometry, timing and actors.

distance = 0.3 map + 0.3 routes + 0.2 timing + 0.2 actors, each term in [0, 1]

map: 0 on the same network, else 1. routes: share of (first lane, last lane) pairs of CAVs that only one scenario has
(Jaccard distance of multisets). timing: mean difference of start positions over CAVs with the same route, 10 m or more
counting 1; 1 without such CAVs. actors: Jaccard distance of the multisets of (kind, model) of scripted road users and
of the edges of reactive vehicles.
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping
from statistics import fmean

from mdrive_sumo.core import portable
from mdrive_sumo.scenario.scenario import Ego, Scenario

DUPLICATE_DISTANCE = 0.12
"""Scenarios nearer to each other than this are duplicates."""
FAR_M = 10.0
"""Starts that differ by this or more count as wholly different, see above."""


def scenario_distance(one: Scenario, other: Scenario) -> float:
    """Return the distance in [0, 1]: 0 for the same scenario, whatever its id."""
    maps = float(one.network != other.network)
    ways = _jaccard_distance(map(_route_key, one.egos), map(_route_key, other.egos))
    actors = _jaccard_distance(_actor_types(one), _actor_types(other))
    return 0.3 * maps + 0.3 * ways + 0.2 * _timing_distance(one, other) + 0.2 * actors


def find_duplicate(scenario: Scenario, accepted: Iterable[Scenario]) -> Scenario | None:
    """Return the nearest of the accepted scenarios if it is a duplicate of this one."""
    nearest = min(accepted, key=lambda other: scenario_distance(scenario, other), default=None)
    return nearest if nearest is not None and scenario_distance(scenario, nearest) < DUPLICATE_DISTANCE else None


def find_rivals(scenarios: Iterable[Scenario]) -> Mapping[str, frozenset[str]]:
    """Return by id the ids of the scenarios that are duplicates of it."""
    by_network: dict[str, list[Scenario]] = {}
    for scenario in scenarios:
        by_network.setdefault(scenario.network, []).append(scenario)  # no duplicates on different networks
    return {
        one.id: frozenset(
            other.id for other in here if other is not one and scenario_distance(one, other) < DUPLICATE_DISTANCE
        )
        for here in by_network.values()
        for one in here
    }


def _route_key(ego: Ego) -> tuple[str, str]:
    return ego.lanes[0], ego.lanes[-1]


def _actor_types(scenario: Scenario) -> Iterable[Hashable]:
    yield from ((actor.kind, actor.model) for actor in scenario.actors)
    yield from (("reactive", vehicle.edges) for vehicle in scenario.background.vehicles)


def _timing_distance(one: Scenario, other: Scenario) -> float:
    if one.network != other.network:
        return 1.0
    gaps = [
        float(portable.hypot(a.start.x - b.start.x, a.start.y - b.start.y))
        for a, b in zip(sorted(one.egos, key=_sort_key), sorted(other.egos, key=_sort_key), strict=False)
        if _route_key(a) == _route_key(b)
    ]
    return fmean(min(gap / FAR_M, 1.0) for gap in gaps) if gaps else 1.0


def _sort_key(ego: Ego) -> tuple[tuple[str, str], float, float]:
    return _route_key(ego), ego.start.x, ego.start.y


def _jaccard_distance(one: Iterable[Hashable], other: Iterable[Hashable]) -> float:
    a, b = Counter(one), Counter(other)
    union = (a | b).total()
    return 1.0 - (a & b).total() / union if union else 0.0
