"""Validation of a suite as a whole: does it match its name and its seal?

Suites named like the paper's buckets are compared with its tables, and need conflicts that are hidden until late.
Checksum, recipes and certificates in a suite's folder must belong to its scenarios.
"""

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase

from mdrive_sumo.generate.validation.hard_suite_validation import (
    describe_hard_suite,
    find_hard_problems,
    is_hard_suite,
)
from mdrive_sumo.generate.validation.hard_validation import HARD_BUCKET
from mdrive_sumo.generate.validation.rule_coverage import find_missing_rules
from mdrive_sumo.generate.validation.scenario_validation import ScenarioValidation
from mdrive_sumo.scenario.categories import FIGURES, FLOOR, MEANS, WEATHER_OF_TEN, Category, compute_deviations
from mdrive_sumo.scenario.packaged_suites import name_packaged_suite
from mdrive_sumo.scenario.reference_times import (
    REFERENCE_TIMES_FILE,
    describe_stored_times,
    find_reference_times,
    list_unmeasured,
)
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import PAPER, SuiteStatistics, compute_suite_statistics
from mdrive_sumo.scenario.suite import RECIPE_FILE, Suite
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE, OcclusionCertificateFile

TOLERANCE, CATEGORY_TOLERANCE = 0.05, 0.10
"""Relative tolerance of the means of a suite, and of its categories, against the paper's."""
ROUNDING = 1e-9
"""Rounding tolerance: 0.4 is not further from 0.3 than 0.1."""
MIN_OCCLUDED: Mapping[str, Mapping[str, int]] = {
    "interdrive": {"*": 15},
    "interaction": {"pre-crash": 10, "crosswalk": 10},
}
"""Suite -> category -> least number of conflicts that are hidden until late: 15 of 46; 80 % of 12, and all of ten."""
CATEGORY_SUITE = "interaction"
"""The suite for which the paper has a table of categories."""
GENERATED_BUCKETS = ("Interaction", HARD_BUCKET)
"""Buckets of generated scenarios."""


def find_suite_problems(suite: Suite, examinations: Sequence[ScenarioValidation]) -> tuple[str, ...]:
    """Return the problems of a suite as a whole, or of each of its parts; raises InputError for an unreadable file.

    The number of hidden conflicts is checked if those of every scenario are known: validated now, or stored with the
    suite.
    """
    of_parts = tuple(
        f"{part.name}: {problem}"
        for part in suite.parts or (suite,)
        for problem in _find_part_problems(part, examinations)
    )
    if not suite.parts or suite.about.only or not is_packaged(suite):
        return of_parts  # a short suite is for quick work: the whole season beside it has every rule
    missing = find_missing_rules(suite)
    return (*of_parts, *(f"{suite.name}: expected a scenario that exercises {rule}, found none" for rule in missing))


def describe_suite(suite: Suite) -> tuple[str, ...]:
    """Return remarks about a suite, or its parts."""
    return tuple(f"{part.name}: {note}" for part in suite.parts or (suite,) for note in _describe_part(part))


def _find_part_problems(suite: Suite, examinations: Sequence[ScenarioValidation]) -> Iterator[str]:
    ours = {scenario.id for scenario in suite.scenarios}
    examined = [one for one in examinations if one.scenario in ours]
    yield from _compare_with_paper(suite)
    if suite.about.name == CATEGORY_SUITE:
        yield from _compare_categories(suite.scenarios)
    if is_hard_suite(suite):
        yield from find_hard_problems(suite, examined, _describe_remedy(suite), must_be_complete=is_packaged(suite))
    else:
        yield from _check_certificates(suite, examined)
    yield from _check_reference_times(suite, examined)
    if is_packaged(suite) and not suite.about.checksum:
        yield "suite.json: checksum: expected one, as in every suite that comes with mdrive-sumo, found none"
    if missing := _find_missing_recipes(suite):
        yield (
            f"expected {RECIPE_FILE} beside each of {len(ours)} scenarios, found {len(ours) - len(missing)};"
            f" {missing[0]} has none"
        )


def is_packaged(suite: Suite) -> bool:
    """Return whether a suite comes with mdrive-sumo."""
    return name_packaged_suite(suite.folder) is not None


def _compare_with_paper(suite: Suite) -> Iterator[str]:
    if (paper := PAPER.get(suite.about.name)) is None:
        return
    found = compute_suite_statistics(suite.scenarios)
    if found.scenarios != paper.scenarios:
        yield f"expected {paper.scenarios} scenarios, found {found.scenarios}"
    yield from _find_deviations(_list_means(found), _list_means(paper), TOLERANCE)


def _list_means(of: SuiteStatistics) -> tuple[float, ...]:
    return of.mean_cavs, of.mean_route_m, of.mean_heading_change_deg, of.mean_actors


def _find_deviations(found: Sequence[float], wanted: Sequence[float], tolerance: float) -> Iterator[str]:
    """Yield the means that deviate from the wanted ones by more than the tolerance."""
    for name, mean, aim, floor, off in zip(MEANS, found, wanted, FLOOR, compute_deviations(found, wanted), strict=True):
        if abs(off) > tolerance + ROUNDING:
            yield f"{name}: expected {aim:g} +- {max(aim, floor) * tolerance:.2g} on average, found {mean:.2f}"


def _compare_categories(scenarios: Sequence[Scenario]) -> Iterator[str]:
    names = dict.fromkeys([*map(str, FIGURES), *(scenario.category for scenario in scenarios)])
    for name in names:
        here = [scenario for scenario in scenarios if scenario.category == name]
        figures = FIGURES.get(Category(name)) if name in set(Category) else None
        wanted = figures.count if figures else 0
        if len(here) != wanted:
            yield f"{name}: expected {wanted} scenarios, found {len(here)}"
        if here and figures:
            off = _find_deviations(_list_means(compute_suite_statistics(here)), figures.means, CATEGORY_TOLERANCE)
            yield from (f"{name}: {problem}" for problem in (*off, *_find_weather_deviations(here)))


def _find_weather_deviations(scenarios: Sequence[Scenario]) -> Iterator[str]:
    """Compare the weather with the paper's shares: exact for ten scenarios, within one for other numbers."""
    total = len(scenarios)
    for weather, of_ten in WEATHER_OF_TEN.items():
        found = sum(scenario.weather == weather for scenario in scenarios)
        if abs(found - total * of_ten / 10) >= 1.0:
            yield f"weather {weather}: expected {of_ten} of ten scenarios, found {found} of {total}"


def _check_occluded_count(suite: Suite, known: Mapping[str, bool]) -> Iterator[str]:
    for category, least in MIN_OCCLUDED.get(suite.about.name, {}).items():
        names = [scenario.id for scenario in suite.scenarios if fnmatchcase(scenario.category, category)]
        hidden = sum(known.get(name, False) for name in names)
        if hidden < least and all(name in known for name in names):
            where = "" if category == "*" else f"{category}: "
            yield f"{where}expected {least} conflicts or more that are hidden until late, found {hidden}"


def _check_certificates(suite: Suite, examined: Sequence[ScenarioValidation]) -> Iterator[str]:
    """Check whether the stored certificates belong to the suite, are still true, and report enough hidden conflicts."""
    mend = _describe_remedy(suite)
    file = OcclusionCertificateFile.read(suite.folder)
    kept = file.of(suite) if file else {}
    changed = [one.scenario for one in examined if one.certificate not in (None, kept.get(one.scenario))]
    if file is None and is_packaged(suite):
        yield f"expected {CERTIFICATE_FILE}, as in every suite that comes with mdrive-sumo, found none; {mend}"
    elif file is not None and file.suite_checksum != suite.checksum():
        yield (
            f"{CERTIFICATE_FILE}: expected certificates of {suite.checksum()[:19]}...,"
            f" found those of {file.suite_checksum[:19]}...; {mend}"
        )
    elif file is not None and changed:
        yield f"{CERTIFICATE_FILE}: expected what was just found, found otherwise for {changed[0]}; {mend}"
    known = {name: one.occluded for name, one in kept.items()} | {one.scenario: one.is_occluded for one in examined}
    yield from _check_occluded_count(suite, known)


def _describe_remedy(suite: Suite) -> str:
    return f"`mdrive-sumo validate {suite.name if is_packaged(suite) else suite.folder} --write` makes it anew"


def _check_reference_times(suite: Suite, examined: Sequence[ScenarioValidation]) -> Iterator[str]:
    """Check whether the stored reference times belong to the scenarios and are still true."""
    remedy = _describe_remedy(suite)
    if not (suite.folder / REFERENCE_TIMES_FILE).is_file():
        if is_packaged(suite):
            yield f"expected {REFERENCE_TIMES_FILE}, as in every packaged suite, found none; {remedy}"
        return
    by_id = {scenario.id: scenario for scenario in suite.scenarios}
    if missing := list_unmeasured(suite):
        found = describe_stored_times(by_id[missing[0]], suite.folder)
        yield f"{REFERENCE_TIMES_FILE}: {missing[0]}: expected times of the scenario as it is, found {found}; {remedy}"
    measured = {one.scenario: one.reference for one in examined if one.reference and one.scenario not in missing}
    for name, ticks in measured.items():
        if (kept := find_reference_times(by_id[name], suite.folder)) and kept != ticks:
            yield f"{REFERENCE_TIMES_FILE}: expected what was just found, found otherwise for {name}; {remedy}"
            break


def _find_missing_recipes(suite: Suite) -> tuple[str, ...]:
    """Return the scenarios of a generated suite without a recipe; checked for packaged suites, and where other
    scenarios have one."""
    missing = tuple(s.id for s in suite.scenarios if not (suite.folder / s.id / RECIPE_FILE).is_file())
    ours = is_packaged(suite) and any(scenario.bucket in GENERATED_BUCKETS for scenario in suite.scenarios)
    return missing if ours or len(missing) < len(suite.scenarios) else ()


def _describe_part(suite: Suite) -> Iterator[str]:
    if is_hard_suite(suite):
        yield describe_hard_suite(suite)
    if not any(scenario.bucket in GENERATED_BUCKETS for scenario in suite.scenarios):
        return
    found = sum((suite.folder / scenario.id / RECIPE_FILE).is_file() for scenario in suite.scenarios)
    yield f"{found} of {len(suite.scenarios)} scenarios have a {RECIPE_FILE}" + (
        "; `generate --rebuild` makes those of this version again" if found else ": they cannot be made again"
    )
