"""Validation of a suite of the hard tier as a whole: how many scenarios, categories, certificates and corridors."""

from collections.abc import Iterator, Sequence
from statistics import fmean

from mdrive_sumo.generate.hard.family_streets import is_corridor_network
from mdrive_sumo.generate.validation.hard_validation import HARD_BUCKET
from mdrive_sumo.generate.validation.scenario_validation import ScenarioValidation
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.study.need_certificate import NEED_FILE, load_need, read_need

HARD_SUITE = "hard"
"""The packaged suite."""
LEAST_SCENARIOS, LEAST_CATEGORIES, LEAST_CERTIFIED = 120, 10, 80
"""What the packaged suite has at least (docs/hard.md): scenarios, categories, certificates of need that hold."""
LEAST_CORRIDORS = 1 / 3
"""Share of its scenarios on dense corridors."""


def is_hard_suite(suite: Suite) -> bool:
    """Return whether a suite without parts is one of the hard tier."""
    return any(scenario.bucket == HARD_BUCKET for scenario in suite.scenarios)


def find_hard_problems(
    suite: Suite, examined: Sequence[ScenarioValidation], remedy: str, *, must_be_complete: bool
) -> Iterator[str]:
    """Yield the problems of a suite of the hard tier as a whole. Raises InputError for an unreadable file.

    must_be_complete: it comes with mdrive-sumo, so it needs certificates and, named `hard`, all that docs/hard.md
    promises.
    """
    yield from _check_need(suite, examined, remedy, must_be_complete)
    if must_be_complete and suite.name == HARD_SUITE:
        yield from _count_scenarios(suite)


def describe_hard_suite(suite: Suite) -> str:
    """Return a remark about a suite of the hard tier."""
    categories = len({scenario.category for scenario in suite.scenarios})
    certificates = load_need(suite)
    holding = [one for one in certificates.values() if one.holds]
    return (
        f"{len(suite)} scenarios in {categories} categories, {_count_corridors(suite)} on dense corridors,"
        f" {len(holding)} with a certificate of need that holds"
        + (f" (a message gains {fmean(one.lead_s for one in holding):.1f} s on average)" if holding else "")
    )


def _check_need(
    suite: Suite, examined: Sequence[ScenarioValidation], remedy: str, must_be_complete: bool
) -> Iterator[str]:
    """Check whether the stored certificates belong to the suite and are still true."""
    file = read_need(suite.folder)
    if file is None:
        if must_be_complete:
            yield f"expected {NEED_FILE}, as in every packaged suite of the hard tier, found none; {remedy}"
        return
    if file.suite_checksum != suite.checksum():
        yield (
            f"{NEED_FILE}: expected certificates of {suite.checksum()[:19]}..., found those of"
            f" {file.suite_checksum[:19]}...; {remedy}"
        )
        return
    kept, ours = file.of(suite), {scenario.id for scenario in suite.scenarios}
    if missing := sorted(ours - set(kept)):
        yield f"{NEED_FILE}: expected a certificate of each scenario, found none of {missing[0]}; {remedy}"
    found = (one for one in examined if one.hard is not None and one.scenario in kept)
    if changed := [one.scenario for one in found if one.hard and one.hard.need != kept[one.scenario]]:
        yield f"{NEED_FILE}: expected what was just found, found otherwise for {changed[0]}; {remedy}"


def _count_scenarios(suite: Suite) -> Iterator[str]:
    if len(suite) < LEAST_SCENARIOS:
        yield f"expected {LEAST_SCENARIOS} scenarios or more, found {len(suite)}"
    if (categories := len({scenario.category for scenario in suite.scenarios})) < LEAST_CATEGORIES:
        yield f"expected {LEAST_CATEGORIES} categories or more, found {categories}"
    if (holding := sum(one.holds for one in load_need(suite).values())) < LEAST_CERTIFIED:
        yield f"expected {LEAST_CERTIFIED} certificates of need that hold, found {holding}"
    if (corridors := _count_corridors(suite)) < LEAST_CORRIDORS * len(suite):
        yield f"expected a third of {len(suite)} scenarios on dense corridors, found {corridors}"


def _count_corridors(suite: Suite) -> int:
    return sum(is_corridor_network(scenario.network) for scenario in suite.scenarios)
