"""Validation of a suite of the hard tier as a whole: scenarios, places, certificates, traffic control."""

from collections import Counter
from collections.abc import Iterator, Sequence
from statistics import fmean

from mdrive_sumo.generate.hard.met_controls import count_met_controls
from mdrive_sumo.generate.hard.suite_requirements import (
    CONTROLLED_SHARE,
    LEAST_CATEGORIES,
    LEAST_PLACES,
    LEAST_PROVEN,
    LEAST_SCENARIOS,
    MOST_OF_PLACE,
    OF_EACH_CATEGORY,
    PROVEN_PLACES,
)
from mdrive_sumo.generate.validation.hard_validation import HARD_BUCKET
from mdrive_sumo.generate.validation.scenario_validation import ScenarioValidation
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.season import FIRST_SEASON
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.study.need_certificate import NEED_FILE, NeedCertificateFile, Proof

HARD_SUITE = "hard"
"""Name of the suites that come with mdrive-sumo."""


def is_hard_suite(suite: Suite) -> bool:
    """Return whether a suite without parts is one of the hard tier."""
    return any(scenario.bucket == HARD_BUCKET for scenario in suite.scenarios)


def find_hard_problems(
    suite: Suite, examined: Sequence[ScenarioValidation], remedy: str, *, must_be_complete: bool
) -> Iterator[str]:
    """Yield the problems of a suite of the hard tier as a whole. Raises InputError for an unreadable file.

    must_be_complete: it comes with mdrive-sumo, so it needs certificates and, named `hard`, all that docs/hard.md
    promises; season 0 is older than these promises.
    """
    yield from _check_need(suite, examined, remedy, must_be_complete)
    if must_be_complete and suite.about.name == HARD_SUITE and suite.season != FIRST_SEASON:
        yield from _count_scenarios(suite)


def describe_hard_suite(suite: Suite) -> str:
    """Return a remark about a suite of the hard tier."""
    categories = len({scenario.category for scenario in suite.scenarios})
    certificates = NeedCertificateFile.load(suite)
    holding = [one for one in certificates.values() if one.holds]
    return (
        f"{len(suite)} scenarios in {categories} categories on {len({one.network for one in suite.scenarios})} places,"
        f" {len(holding)} with a certificate of need that holds"
        + (f" (a message gains {fmean(one.lead_s for one in holding):.1f} s on average)" if holding else "")
    )


def _check_need(
    suite: Suite, examined: Sequence[ScenarioValidation], remedy: str, must_be_complete: bool
) -> Iterator[str]:
    """Check whether the stored certificates belong to the suite and are still true."""
    file = NeedCertificateFile.read(suite.folder)
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
    """Compare a season with what docs/hard.md promises of every season."""
    if len(suite) < LEAST_SCENARIOS:
        yield f"expected {LEAST_SCENARIOS} scenarios or more, found {len(suite)}"
    categories = Counter(scenario.category for scenario in suite.scenarios)
    if (enough := sum(count >= OF_EACH_CATEGORY for count in categories.values())) < LEAST_CATEGORIES:
        yield f"expected {LEAST_CATEGORIES} categories with {OF_EACH_CATEGORY} scenarios or more, found {enough}"
    places = Counter(scenario.network for scenario in suite.scenarios)
    if len(places) < LEAST_PLACES:
        yield f"expected {LEAST_PLACES} places or more, found {len(places)}"
    name, most = places.most_common(1)[0]
    if most > MOST_OF_PLACE:
        yield f"expected {MOST_OF_PLACE} scenarios of a place at most, found {most} on {name}"
    yield from _count_proven(suite)
    met, routes = _count_controlled(suite)
    if met < CONTROLLED_SHARE * routes:
        yield f"expected a third of {routes} routes to meet a sign or lights, found {met}"


def _count_proven(suite: Suite) -> Iterator[str]:
    certificates = NeedCertificateFile.load(suite)
    proven = [one for one in suite.scenarios if one.id in certificates and certificates[one.id].proves is Proof.ALL]
    if len(proven) < LEAST_PROVEN:
        yield f"expected {LEAST_PROVEN} certificates of level all, found {len(proven)}"
    if (places := len({one.network for one in proven})) < PROVEN_PLACES:
        yield f"expected certificates of level all on {PROVEN_PLACES} places, found them on {places}"


def _count_controlled(suite: Suite) -> tuple[int, int]:
    """Return how many routes meet a sign or lights, and how many there are."""
    met = (
        count_met_controls(scenario, load_road_map(find_network_folder(scenario.network, suite.folder)))
        for scenario in suite.scenarios
    )
    return sum(met), sum(len(scenario.egos) for scenario in suite.scenarios)
