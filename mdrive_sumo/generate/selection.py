"""Selection: of a pool of good scenarios those whose means are the paper's for their category."""

import random
from collections.abc import Sequence

from mdrive_sumo.scenario.categories import CategoryFigures, compute_deviations
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length

SWAPS = 6000
CROWDED, ALIKE = 0.02, 0.3
"""Cost of every scenario on the same network as another one, or with the same description: variety."""


def select_scenarios(
    pool: Sequence[Scenario], figures: CategoryFigures, count: int, rng: random.Random
) -> tuple[Scenario, ...]:
    """`count` scenarios of the pool, in its order, that come closest to the figures: random swaps that never worsen."""
    sizes = [_sizes(scenario) for scenario in pool]
    chosen = sorted(rng.sample(range(len(pool)), count))
    cost = _cost(chosen, pool, sizes, figures)
    for _ in range(SWAPS if len(pool) > count else 0):
        out = rng.randrange(count)
        candidate = sorted({*chosen[:out], *chosen[out + 1 :], rng.randrange(len(pool))})
        if len(candidate) == count and (better := _cost(candidate, pool, sizes, figures)) <= cost:
            chosen, cost = candidate, better
    return tuple(pool[i] for i in chosen)


Sizes = tuple[int, float, float, int]
"""CAVs, sum of their route lengths [m], sum of their heading changes [deg], actors."""


def _sizes(scenario: Scenario) -> Sizes:
    egos = scenario.egos
    actors = len(scenario.actors) + len(scenario.background.vehicles)
    return len(egos), sum(map(compute_route_length, egos)), sum(map(compute_heading_change_deg, egos)), actors


def _cost(chosen: Sequence[int], pool: Sequence[Scenario], sizes: Sequence[Sizes], figures: CategoryFigures) -> float:
    cavs, route, heading, actors = (sum(sizes[i][k] for i in chosen) for k in range(4))
    found = (cavs / len(chosen), route / cavs, heading / cavs, actors / len(chosen))
    crowd = len(chosen) - len({pool[i].network for i in chosen})
    alike = len(chosen) - len({pool[i].description for i in chosen})
    return sum(error**2 for error in compute_deviations(found, figures.means)) * 100 + CROWDED * crowd + ALIKE * alike
