"""Which scenarios each part of the study drives: all, a quarter or few of every kind; the choice is never random."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.categories import LEVELS, Category
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring.category_groups import GROUPS

T = TypeVar("T")
LOG_BUCKET = "V2XPnP"
"""Bucket of the paper's open-loop comparison (RQ3), latency and pose-error tables (RQ5)."""
CHANNEL_SCENARIOS = 21
"""Scenarios of the latency and pose-error tables (paper, RQ5); it does not name them."""
QUICK_LOG_SCENARIOS = 2
"""Scenarios of `LOG_BUCKET` in a quick study, which shall take three minutes on two cores."""
STANDARD_SHARE = 4
"""A standard study drives one of so many scenarios of each category, so that it takes half an hour on two cores."""
MIN_STRATUM = 5
"""Least number of scenarios of an interactivity level or InterDrive group in a standard study. An interval needs more
(`core.statistics.MIN_UNITS`), for which a standard study would take twice its half hour."""


class PaperScale(StrEnum):
    """How many scenarios a study drives."""

    QUICK = "quick"
    STANDARD = "standard"
    WHOLE = "whole"


@dataclass(frozen=True, slots=True)
class PaperPlan:
    """Ids of the scenarios of each part, in the order of the suite."""

    scale: PaperScale
    closed: tuple[str, ...]
    """Main table, category tables and figure (RQ1, RQ2)."""
    logs: tuple[str, ...]
    """Those that agents see in open loop too (RQ3): of `LOG_BUCKET`, or all if the suite has none."""
    channel: tuple[str, ...]
    """Those that are driven over worse channels too (RQ5): of `logs`, with two CAVs or more; as many as the paper has
    if they are of `LOG_BUCKET`."""


def make_plan(suite: Suite, scale: PaperScale) -> PaperPlan:
    """Return the scenarios of a study. Raises InputError if no scenario has two CAVs.

    QUICK: of each stratum the one with the shortest routes, and `QUICK_LOG_SCENARIOS` such logs. STANDARD: a quarter of
    each category, at least `MIN_STRATUM` of each stratum, and of the logs `CHANNEL_SCENARIOS` with two CAVs or more and
    as large a share of the others. WHOLE: all.
    """
    logs = [scenario for scenario in suite if scenario.bucket == LOG_BUCKET]
    others = [scenario for scenario in suite if scenario.bucket != LOG_BUCKET]
    if scale is PaperScale.QUICK:
        logs = choose_shortest(split_by_cavs(logs)[0] or logs, QUICK_LOG_SCENARIOS)
        others = [
            scenario for stratum in split_strata(others, name_stratum) for scenario in choose_shortest(stratum, 1)
        ]
    elif scale is PaperScale.STANDARD:
        logs = _choose_standard_logs(logs)
        others = [scenario for stratum in split_strata(others, name_stratum) for scenario in _choose_standard(stratum)]
    closed, seen = ({scenario.id for scenario in chosen} for chosen in ((*logs, *others), logs or others))
    cooperative, _ = split_by_cavs([scenario for scenario in suite if scenario.id in seen])
    if not cooperative:
        raise InputError(f"suite {suite.name}: expected scenarios with two CAVs or more, found none")
    return PaperPlan(
        scale,
        tuple(scenario.id for scenario in suite if scenario.id in closed),
        tuple(scenario.id for scenario in suite if scenario.id in seen),
        tuple(scenario.id for scenario in (choose_evenly(cooperative, CHANNEL_SCENARIOS) if logs else cooperative)),
    )


def _choose_standard_logs(logs: Sequence[Scenario]) -> list[Scenario]:
    """Return the logs of a standard study: those of RQ5 must be among them, because clean runs are not repeated."""
    cooperative, alone = split_by_cavs(logs)
    chosen = choose_evenly(cooperative, CHANNEL_SCENARIOS)
    share = round(len(alone) * len(chosen) / len(cooperative)) if cooperative else _count_share(alone)
    return [*chosen, *choose_evenly(alone, share)]


def _choose_standard(stratum: Sequence[Scenario]) -> list[Scenario]:
    """Return a share of each category of a stratum, and as many more that it has `MIN_STRATUM` scenarios."""
    categories = split_strata(stratum, lambda scenario: scenario.category)
    least = math.ceil(MIN_STRATUM / len(categories))
    return [
        scenario for category in categories for scenario in choose_evenly(category, max(least, _count_share(category)))
    ]


def _count_share(scenarios: Sequence[Scenario]) -> int:
    return max(1, round(len(scenarios) / STANDARD_SHARE))


def split_by_cavs(scenarios: Sequence[Scenario]) -> tuple[list[Scenario], list[Scenario]]:
    """Return the scenarios with two CAVs or more, and the others."""
    parts: tuple[list[Scenario], list[Scenario]] = [], []
    for scenario in scenarios:
        parts[len(scenario.egos) < 2].append(scenario)
    return parts


def split_strata(scenarios: Sequence[Scenario], name_of: Callable[[Scenario], str]) -> list[list[Scenario]]:
    """Return the scenarios of each stratum."""
    strata: dict[str, list[Scenario]] = {}
    for scenario in scenarios:
        strata.setdefault(name_of(scenario), []).append(scenario)
    return [*strata.values()]


def name_stratum(scenario: Scenario) -> str:
    """Return what a scenario is drawn as: its InterDrive group, its interactivity level, or else its category."""
    if scenario.category in set(Category):
        return LEVELS[Category(scenario.category)]
    return GROUPS.get(scenario.category, scenario.category)


def choose_shortest(scenarios: Sequence[Scenario], count: int) -> list[Scenario]:
    """Return the `count` scenarios whose CAVs have the least to drive together, in their order; ties: the earlier."""
    shortest = sorted(scenarios, key=lambda scenario: sum(len(ego.route) for ego in scenario.egos))[:count]
    return [scenario for scenario in scenarios if scenario in shortest]


def choose_evenly(items: Sequence[T], count: int) -> list[T]:
    """Return `count` of the items, or all if there are fewer, in the middle of as many equal stretches."""
    if len(items) <= count:
        return [*items]
    return [items[(2 * place + 1) * len(items) // (2 * count)] for place in range(count)]
