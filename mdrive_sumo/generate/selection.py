"""Selects from a pool the scenarios whose means match the paper's figures of their category."""

import math
import random
from collections.abc import Sequence

from mdrive_sumo.scenario.categories import CategoryFigures, compute_deviations
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length

SWAPS = 6000
SAME_NETWORK_COST, ALIKE = 0.02, 0.3
"""Cost of every scenario on the same network as another one, or with the same description, for variety."""


def select_scenarios(
    pool: Sequence[Scenario], figures: CategoryFigures, count: int, rng: random.Random
) -> tuple[Scenario, ...]:
    """Return `count` scenarios of the pool, in its order, close to the figures: random swaps that never increase the
    cost."""
    sizes = [_measure(scenario) for scenario in pool]
    chosen = sorted(rng.sample(range(len(pool)), count))
    cost = _compute_cost(chosen, pool, sizes, figures)
    for _ in range(SWAPS if len(pool) > count else 0):
        out = rng.randrange(count)
        candidate = sorted({*chosen[:out], *chosen[out + 1 :], rng.randrange(len(pool))})
        if len(candidate) == count and (better := _compute_cost(candidate, pool, sizes, figures)) <= cost:
            chosen, cost = candidate, better
    return tuple(pool[i] for i in chosen)


Sizes = tuple[int, float, float, int]
"""CAVs, sum of their route lengths [m], sum of their heading changes [deg], actors."""


def _measure(scenario: Scenario) -> Sizes:
    egos = scenario.egos
    actors = len(scenario.actors) + len(scenario.background.vehicles)
    route, heading = (math.fsum(map(of, egos)) for of in (compute_route_length, compute_heading_change_deg))
    return len(egos), route, heading, actors


def _compute_cost(
    chosen: Sequence[int], pool: Sequence[Scenario], sizes: Sequence[Sizes], figures: CategoryFigures
) -> float:
    cavs, route, heading, actors = (math.fsum(sizes[i][k] for i in chosen) for k in range(4))
    found = (cavs / len(chosen), route / cavs, heading / cavs, actors / len(chosen))
    crowd = len(chosen) - len({pool[i].network for i in chosen})
    alike = len(chosen) - len({pool[i].description for i in chosen})
    return (
        math.fsum(error * error for error in compute_deviations(found, figures.means)) * 100
        + SAME_NETWORK_COST * crowd
        + ALIKE * alike
    )
