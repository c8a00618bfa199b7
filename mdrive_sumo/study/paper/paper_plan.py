"""Which scenarios each part of the study drives: all of them, or few of every kind; the choice is never random."""

from collections.abc import Sequence
from dataclasses import dataclass
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
QUICK_LOG_SCENARIOS = 3
"""Scenarios of `LOG_BUCKET` in a quick study: with more, it takes longer than three minutes on two cores."""


@dataclass(frozen=True, slots=True)
class PaperPlan:
    """Ids of the scenarios of each part, in the order of the suite."""

    quick: bool
    closed: tuple[str, ...]
    """Main table, category tables and figure (RQ1, RQ2)."""
    logs: tuple[str, ...]
    """Those that agents see in open loop too (RQ3): of `LOG_BUCKET`, or all if the suite has none."""
    channel: tuple[str, ...]
    """Those that are driven over worse channels too (RQ5): of `logs`, with two CAVs or more."""


def make_plan(suite: Suite, *, quick: bool) -> PaperPlan:
    """Return the scenarios of a study: all, or with `quick` one of each stratum and `QUICK_LOG_SCENARIOS` logs.

    Raises InputError if no scenario has two CAVs.
    """
    logs = [scenario for scenario in suite if scenario.bucket == LOG_BUCKET]
    others = [scenario for scenario in suite if scenario.bucket != LOG_BUCKET]
    if quick:
        logs = choose_evenly(_prefer_cooperative(logs), QUICK_LOG_SCENARIOS)
        others = [one for stratum in split_strata(others).values() for one in choose_evenly(stratum, 1)]
    closed, seen = ({one.id for one in chosen} for chosen in ((*logs, *others), logs or others))
    cooperative = [scenario for scenario in suite if scenario.id in seen and len(scenario.egos) > 1]
    if not cooperative:
        raise InputError(f"suite {suite.name}: expected scenarios with two CAVs or more, found none")
    return PaperPlan(
        quick,
        tuple(scenario.id for scenario in suite if scenario.id in closed),
        tuple(scenario.id for scenario in suite if scenario.id in seen),
        tuple(scenario.id for scenario in choose_evenly(cooperative, CHANNEL_SCENARIOS)),
    )


def _prefer_cooperative(scenarios: Sequence[Scenario]) -> Sequence[Scenario]:
    """Return the scenarios with two CAVs or more, because few are chosen and RQ5 needs these; all if none has two."""
    return [scenario for scenario in scenarios if len(scenario.egos) > 1] or scenarios


def split_strata(scenarios: Sequence[Scenario]) -> dict[str, list[Scenario]]:
    """Return the scenarios by InterDrive's group, interactivity level, or else category."""
    found: dict[str, list[Scenario]] = {}
    for scenario in scenarios:
        found.setdefault(name_stratum(scenario), []).append(scenario)
    return found


def name_stratum(scenario: Scenario) -> str:
    """Return what a scenario is drawn as: its InterDrive group, its interactivity level, or else its category."""
    if scenario.category in set(Category):
        return LEVELS[Category(scenario.category)]
    return GROUPS.get(scenario.category, scenario.category)


def choose_evenly(items: Sequence[T], count: int) -> list[T]:
    """Return `count` of the items, or all if there are fewer, in the middle of as many equal stretches."""
    if len(items) <= count:
        return [*items]
    return [items[(2 * place + 1) * len(items) // (2 * count)] for place in range(count)]
