"""Validation of a suite of the hard tier as a whole: how many scenarios, categories, certificates and corridors."""

from collections.abc import Iterator, Sequence

from mdrive_sumo.generate.hard.corridors import is_corridor_network
from mdrive_sumo.generate.validation.hard_validation import HARD_BUCKET
from mdrive_sumo.generate.validation.scenario_validation import ScenarioValidation
from mdrive_sumo.scenario.suite import Suite

HARD_SUITE = "hard"
"""The packaged suite."""
LEAST_SCENARIOS, LEAST_CATEGORIES, LEAST_CERTIFIED = 120, 10, 80
LEAST_CORRIDORS = 1 / 3
"""Share of scenarios on dense corridors. Of the packaged suite, as the numbers above (issue K)."""


def is_hard_suite(suite: Suite) -> bool:
    """Return whether a suite without parts is one of the hard tier."""
    return any(scenario.bucket == HARD_BUCKET for scenario in suite.scenarios)


def find_hard_problems(
    suite: Suite, examined: Sequence[ScenarioValidation], remedy: str, *, must_be_complete: bool
) -> Iterator[str]:
    """Yield the problems of a suite of the hard tier as a whole. Raises InputError for an unreadable file.

    must_be_complete: it comes with mdrive-sumo, so it needs certificates and, named `hard`, all that issue K asks for.
    """
    if must_be_complete and suite.name == HARD_SUITE:
        yield from _count_scenarios(suite)


def describe_hard_suite(suite: Suite) -> str:
    """Return a remark about a suite of the hard tier."""
    categories = len({scenario.category for scenario in suite.scenarios})
    return f"{len(suite)} scenarios in {categories} categories, {_count_corridors(suite)} on dense corridors"


def _count_scenarios(suite: Suite) -> Iterator[str]:
    if len(suite) < LEAST_SCENARIOS:
        yield f"expected {LEAST_SCENARIOS} scenarios or more, found {len(suite)}"
    if (categories := len({scenario.category for scenario in suite.scenarios})) < LEAST_CATEGORIES:
        yield f"expected {LEAST_CATEGORIES} categories or more, found {categories}"
    if (corridors := _count_corridors(suite)) < LEAST_CORRIDORS * len(suite):
        yield f"expected a third of {len(suite)} scenarios on dense corridors, found {corridors}"


def _count_corridors(suite: Suite) -> int:
    return sum(is_corridor_network(scenario.network) for scenario in suite.scenarios)
