"""Selects from a pool the scenarios whose means match the paper's figures."""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.scenario.categories import FLOOR
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length

SWAPS_EACH = 600
"""Random swaps that are tried per scenario to select."""
SAME_NETWORK_COST, ALIKE_COST = 0.02, 0.3
"""Cost of every scenario on the same network as another one, or with the same description, for variety."""
TOLERATED, EXCESS_COST = 0.04, 100.0
"""Relative difference of a mean that varies freely, and cost of what exceeds it: `validate` accepts 5 % of a suite."""
VISIBLE_COST = 1.0
"""Cost of every scenario that lacks an occlusion certificate of those that shall have one."""
Means = tuple[float | None, float | None, float | None, float | None]
"""CAVs and actors of a scenario, route [m] and heading change [deg] of a CAV, as in `categories.MEANS`; None: any."""


@dataclass(frozen=True, slots=True)
class SelectionItem:
    """Figures of a scenario of the pool."""

    id: str
    group: str
    """The required number of each group is selected."""
    cavs: int
    route_m: float
    """Sum over the CAVs."""
    heading_change_deg: float
    """Sum over the CAVs."""
    actors: int
    network: str
    description: str
    is_hidden: bool = False
    """Whether the scenario has an occlusion certificate."""


def build_item(scenario: Scenario, group: str, *, is_hidden: bool = False) -> SelectionItem:
    """Return the figures of a scenario."""
    route, heading = (math.fsum(map(of, scenario.egos)) for of in (compute_route_length, compute_heading_change_deg))
    actors = len(scenario.actors) + len(scenario.background.vehicles)
    about = scenario.network, scenario.description
    return SelectionItem(scenario.id, group, len(scenario.egos), route, heading, actors, *about, is_hidden)


def compute_means(chosen: Sequence[SelectionItem]) -> tuple[float, float, float, float]:
    """Return the means: CAVs and actors over the scenarios, routes and heading changes over the CAVs."""
    cavs = sum(one.cavs for one in chosen)
    route, heading = (
        math.fsum(values) for values in zip(*((i.route_m, i.heading_change_deg) for i in chosen), strict=True)
    )
    return cavs / len(chosen), route / cavs, heading / cavs, sum(one.actors for one in chosen) / len(chosen)


def select_items(
    pool: Sequence[SelectionItem], wanted: Mapping[str, int], means: Means, rng: random.Random, least_hidden: int = 0
) -> tuple[SelectionItem, ...]:
    """Return the wanted number of each group, in the order of the pool, close to the means: random swaps that never
    increase the cost.

    least_hidden: how many of them shall have an occlusion certificate, if the pool has as many.
    """
    groups = {group: [i for i, one in enumerate(pool) if one.group == group] for group in wanted}
    chosen = [i for group, count in wanted.items() for i in rng.sample(groups[group], count)]
    cost = _compute_cost([pool[i] for i in chosen], means, least_hidden)
    for _ in range(SWAPS_EACH * len(chosen) if len(pool) > len(chosen) else 0):
        out = rng.randrange(len(chosen))
        other = rng.choice(groups[pool[chosen[out]].group])
        if other in chosen:
            continue
        candidate = [*chosen[:out], other, *chosen[out + 1 :]]
        if (better := _compute_cost([pool[i] for i in candidate], means, least_hidden)) <= cost:
            chosen, cost = candidate, better
    return tuple(pool[i] for i in sorted(chosen))


def find_deviations(found: Sequence[float], wanted: Means) -> list[float]:
    """Return the relative differences of means, at least per `FLOOR`; 0 where any mean will do."""
    return [
        0.0 if aim is None else (mean - aim) / max(aim, floor)
        for mean, aim, floor in zip(found, wanted, FLOOR, strict=True)
    ]


def _compute_cost(chosen: Sequence[SelectionItem], means: Means, least_hidden: int) -> float:
    errors = find_deviations(compute_means(chosen), means)
    crowd = len(chosen) - len({one.network for one in chosen})
    alike = len(chosen) - len({one.description for one in chosen})
    visible = max(least_hidden - sum(one.is_hidden for one in chosen), 0)
    return (
        math.fsum(error * error for error in errors) * 100
        + math.fsum(max(abs(error) - TOLERATED, 0.0) for error in errors) * EXCESS_COST
        + SAME_NETWORK_COST * crowd
        + ALIKE_COST * alike
        + VISIBLE_COST * visible
    )
