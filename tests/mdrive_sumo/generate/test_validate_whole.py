"""A suite as a whole: the paper's tables, certificates, checksum, recipes; one test for every kind of problem."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from testing import paper_like

from mdrive_sumo.generate.validation import (
    ScenarioValidation,
    describe_suite,
    find_suite_problems,
    sample_scenarios,
    suite_validation,
)
from mdrive_sumo.scenario.packaged_suites import list_packaged_suites
from mdrive_sumo.scenario.reference_times import save_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite, seal_suite
from mdrive_sumo.study.occlusion_certificate import OccludedInterval, OcclusionCertificate, OcclusionCertificateFile

LATE = OccludedInterval(drive="omniscient", ego="0", actor="1", start_s=0.0, end_s=3.0, conflict_s=4.0, by=("1",))


@cache
def interdrive() -> Suite:
    return load_suite("interdrive@0")


def certificate(scenario: str, hidden: bool) -> OcclusionCertificate:
    return OcclusionCertificate(scenario=scenario, hidden=(LATE,) if hidden else ())


def examined(suite: Suite, hidden: bool = True) -> tuple[ScenarioValidation, ...]:
    return tuple(ScenarioValidation(s.id, (), certificate=certificate(s.id, hidden)) for s in suite.scenarios)


@pytest.fixture
def interaction(tmp_path: Path) -> Suite:
    return paper_like.interaction(tmp_path)


def with_changed(suite: Suite, category: str, change: Callable[[int, Scenario], dict[str, object]]) -> Suite:
    """Scenarios of a category changed, each by what `change` says of it."""
    numbered = {s.id: k for k, s in enumerate(s for s in suite.scenarios if s.category == category)}
    scenarios = (s.model_copy(update=change(numbered[s.id], s)) if s.id in numbered else s for s in suite.scenarios)
    return replace(suite, scenarios=tuple(scenarios))


@pytest.mark.slow
def test_a_suite_like_the_papers_has_no_problem(interaction: Suite) -> None:
    assert find_suite_problems(interaction, examined(interaction)) == ()


@pytest.mark.slow
def test_a_suite_of_another_size_is_told(interaction: Suite) -> None:
    short = replace(interaction, scenarios=interaction.scenarios[:-1])
    problems = find_suite_problems(short, ())
    assert "interaction: expected 112 scenarios, found 111" in problems
    assert "interaction: unprotected-left: expected 10 scenarios, found 9" in problems


@pytest.mark.slow
def test_a_category_that_the_paper_lacks_is_told(interaction: Suite) -> None:
    odd = with_changed(interaction, "deadlock", lambda k, _: {"category": "lane-drop" if k == 0 else "deadlock"})
    problems = find_suite_problems(odd, ())
    assert "interaction: lane-drop: expected 0 scenarios, found 1" in problems
    assert "interaction: deadlock: expected 10 scenarios, found 9" in problems


@pytest.mark.slow
def test_a_category_without_scenarios_is_told(interaction: Suite) -> None:
    rest = replace(interaction, scenarios=tuple(s for s in interaction.scenarios if s.category != "crosswalk"))
    assert "interaction: crosswalk: expected 10 scenarios, found 0" in find_suite_problems(rest, ())


def fewer_cavs(scenario: Scenario) -> dict[str, object]:
    return {"egos": scenario.egos[:-1]}


def shorter_routes(scenario: Scenario) -> dict[str, object]:
    return {"egos": tuple(ego.model_copy(update={"route": ego.route[:60]}) for ego in scenario.egos)}


def fewer_actors(scenario: Scenario) -> dict[str, object]:
    return {"actors": scenario.actors[:3]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (fewer_cavs, "deadlock: CAVs: expected 4.7 +- 0.47 on average, found 3.70"),
        (shorter_routes, "roundabout: route [m]: expected 112.1 +- 11 on average, found 59.00"),
        (shorter_routes, "roundabout: heading change [deg]: expected 296.3 +- 30 on average, found "),
        (fewer_actors, "construction: actors: expected 7.1 +- 0.71 on average, found 3.00"),
    ],
)
def test_means_of_a_category_far_from_the_papers_are_told(
    interaction: Suite, change: Callable[[Scenario], dict[str, object]], problem: str
) -> None:
    changed = with_changed(interaction, problem.partition(":")[0], lambda _, scenario: change(scenario))
    assert any(told.startswith(f"interaction: {problem}") for told in find_suite_problems(changed, ()))


@pytest.mark.slow
def test_small_means_are_compared_as_differences(interaction: Suite) -> None:
    """0.3 actors in unprotected left turns: 0.4 are within a tenth of one actor, 0.5 are not."""
    cone = next(s for s in interaction.scenarios if s.actors).actors[0]

    def problems(cones: int) -> tuple[str, ...]:
        actors = [(cone,) if k < cones else () for k in range(10)]
        changed = with_changed(interaction, "unprotected-left", lambda k, _: {"actors": actors[k]})
        return find_suite_problems(changed, ())

    assert problems(4) == ()
    assert problems(5) == ("interaction: unprotected-left: actors: expected 0.3 +- 0.1 on average, found 0.50",)


def test_means_of_a_suite_far_from_the_papers_are_told(tmp_path: Path) -> None:
    """One actor is a tenth of what InterDrive may have in all: it has none."""
    suite = interdrive()
    cone = next(s for s in paper_like.interaction(tmp_path).scenarios if s.actors).actors[0]
    crowded = tuple(s.model_copy(update={"actors": (cone,)}) for s in suite.scenarios)
    problems = find_suite_problems(Suite(suite.about, tmp_path, crowded), ())
    assert problems == ("interdrive: actors: expected 0 +- 0.05 on average, found 1.00",)


@pytest.mark.slow
def test_weather_that_is_not_the_papers_is_told(interaction: Suite) -> None:
    wet = with_changed(interaction, "overtaking", lambda k, s: {"weather": "rain" if k < 3 else s.weather})
    assert find_suite_problems(wet, ()) == (
        "interaction: overtaking: weather cloudy: expected 3 of ten scenarios, found 2 of 10",
        "interaction: overtaking: weather night: expected 3 of ten scenarios, found 2 of 10",
        "interaction: overtaking: weather default: expected 2 of ten scenarios, found 1 of 10",
        "interaction: overtaking: weather rain: expected 2 of ten scenarios, found 5 of 10",
    )


@pytest.mark.slow
@pytest.mark.parametrize(("category", "least"), [("pre-crash", 10), ("crosswalk", 10)])
def test_too_few_hidden_conflicts_in_a_category_are_told(interaction: Suite, category: str, least: int) -> None:
    names = [s.id for s in interaction.scenarios if s.category == category]
    plain = names[least - 1 :]
    found = [
        ScenarioValidation(s.id, (), certificate=certificate(s.id, s.id not in plain)) for s in interaction.scenarios
    ]
    (problem,) = find_suite_problems(interaction, found)
    assert problem == (
        f"interaction: {category}: expected {least} conflicts or more that are hidden until late, found {least - 1}"
    )


@pytest.mark.slow
def test_hidden_conflicts_are_not_counted_while_some_are_unknown(interaction: Suite) -> None:
    assert find_suite_problems(interaction, examined(interaction, hidden=False)[:-20]) != ()
    few = [one for one in examined(interaction, hidden=False) if not one.scenario.endswith("_01")]
    assert find_suite_problems(interaction, few) == ()


@pytest.mark.slow
def test_kept_certificates_count_where_only_a_sample_was_driven(interaction: Suite) -> None:
    OcclusionCertificateFile.write(interaction, {s.id: certificate(s.id, hidden=False) for s in interaction.scenarios})
    assert len(find_suite_problems(interaction, ())) == 2


# Suites of two scenarios on disk from here on.


@pytest.fixture
def small(tmp_path: Path) -> Suite:
    about = SuiteFile(name="small", title="Two of ours")
    save_suite(Suite(about, tmp_path / "small", interdrive().scenarios[:2]))
    return load_suite(str(tmp_path / "small"))


def keep(suite: Suite, hidden: bool = True) -> None:
    OcclusionCertificateFile.write(suite, {s.id: certificate(s.id, hidden) for s in suite.scenarios})


def measure(suite: Suite, ticks: int = 50) -> None:
    save_reference_times(suite, {s.id: {ego.id: ticks for ego in s.egos} for s in suite.scenarios})


def test_nothing_is_asked_of_a_suite_of_ones_own(small: Suite) -> None:
    assert find_suite_problems(small, examined(small)) == ()
    assert describe_suite(small) == ()


def test_stale_certificates_are_told(small: Suite) -> None:
    keep(small)
    assert find_suite_problems(small, ()) == ()
    save_suite(replace(small, scenarios=(small.scenarios[0].model_copy(update={"description": "new"}),)))
    (problem,) = find_suite_problems(load_suite(str(small.folder)), ())
    assert problem.startswith("small: occlusion.json: expected certificates of sha256:")
    assert problem.endswith(f"; `mdrive-sumo validate {small.folder} --write` makes it anew")


def test_certificates_that_are_no_longer_found_are_told(small: Suite) -> None:
    keep(small)
    assert find_suite_problems(small, examined(small)) == ()
    (problem,) = find_suite_problems(small, examined(small, hidden=False))
    assert f"expected what was just found, found otherwise for {small.scenarios[0].id}" in problem


@pytest.fixture
def packaged(small: Suite, monkeypatch: pytest.MonkeyPatch) -> Suite:
    """The small suite, as if it came with mdrive-sumo."""
    monkeypatch.setattr(suite_validation, "name_packaged_suite", {small.folder: "small"}.get)
    return small


def test_a_packaged_suite_has_checksum_and_certificates(packaged: Suite) -> None:
    checksum, times, certificates = sorted(find_suite_problems(packaged, ()), reverse=True)
    assert checksum == (
        "small: suite.json: checksum: expected one, as in every suite that comes with mdrive-sumo, found none"
    )
    assert certificates.startswith("small: expected occlusion.json, as in every suite that comes with mdrive-sumo,")
    assert times.startswith("small: expected reference_times.json, as in every packaged suite, found none; `mdrive")
    save_suite(seal_suite(packaged))
    keep(packaged)
    measure(packaged)
    assert find_suite_problems(load_suite(str(packaged.folder)), ()) == ()


def generated(suite: Suite, *recipes: Scenario) -> Suite:
    """The suite as if it were generated, with recipes beside some of its scenarios, sealed and certified."""
    scenarios = tuple(s.model_copy(update={"bucket": "Interaction"}) for s in suite.scenarios)
    made = seal_suite(replace(suite, scenarios=scenarios))
    save_suite(made)
    keep(made)
    measure(made)
    for scenario in recipes:
        (suite.folder / scenario.id / suite_validation.RECIPE_FILE).write_text("{}")
    return load_suite(str(suite.folder))


def test_a_packaged_generated_suite_has_every_recipe(packaged: Suite) -> None:
    first, second = packaged.scenarios
    bare = find_suite_problems(generated(packaged), ())
    assert bare == (f"small: expected recipe.json beside each of 2 scenarios, found 0; {first.id} has none",)
    half = find_suite_problems(generated(packaged, first), ())
    assert half == (f"small: expected recipe.json beside each of 2 scenarios, found 1; {second.id} has none",)
    made = generated(packaged, first, second)
    assert find_suite_problems(made, ()) == ()
    assert describe_suite(made) == (
        "small: 2 of 2 scenarios have a recipe.json; `generate --rebuild` makes those of this version again",
    )


def test_generated_scenarios_of_ones_own_need_no_recipes(small: Suite) -> None:
    made = generated(small)
    assert find_suite_problems(made, ()) == ()
    assert describe_suite(made) == ("small: 0 of 2 scenarios have a recipe.json: they cannot be made again",)


def composite(folder: Path, *sizes: int) -> Suite:
    """A suite of parts "a", "b" ... with so many scenarios each."""
    scenarios, names = iter(interdrive().scenarios), "abc"[: len(sizes)]
    for name, size in zip(names, sizes, strict=True):
        save_suite(Suite(SuiteFile(name=name, title=name), folder / name, tuple(next(scenarios) for _ in range(size))))
    save_suite(Suite(SuiteFile(name="all", title="All", parts=tuple(names)), folder / "all", ()))
    return load_suite(str(folder / "all"))


def test_a_sample_has_scenarios_of_every_part_in_proportion(tmp_path: Path) -> None:
    suite = composite(tmp_path, 5, 20, 10)
    for size, counts in ((3, (0, 2, 1)), (7, (1, 4, 2)), (14, (2, 8, 4))):
        drawn = sample_scenarios(suite, size)
        assert drawn == sample_scenarios(suite, size)
        assert [sum(s in part.scenarios for s in drawn) for part in suite.parts] == list(counts)
    assert sample_scenarios(suite, None) == suite.scenarios


def test_each_part_is_checked_on_its_own(tmp_path: Path) -> None:
    suite = composite(tmp_path, 1, 2)
    keep(suite.parts[0])
    keep(suite.parts[1])
    assert find_suite_problems(suite, examined(suite)) == ()
    keep(suite.parts[1], hidden=False)
    (problem,) = find_suite_problems(suite, examined(suite))
    assert problem.startswith("b: occlusion.json: expected what was just found")


def test_a_whole_packaged_season_has_every_rule_and_a_short_one_need_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite = composite(tmp_path, 1, 2)
    keep(suite.parts[0])
    keep(suite.parts[1])
    monkeypatch.setattr(suite_validation, "name_packaged_suite", {suite.folder: "all"}.get)
    missing = find_suite_problems(suite, examined(suite))
    assert missing and all(told.startswith("all: expected a scenario that exercises ") for told in missing)
    short = replace(suite, about=suite.about.model_copy(update={"only": (suite.scenarios[0].id,)}))
    assert find_suite_problems(short, examined(suite)) == ()


@pytest.mark.slow
def test_every_packaged_suite_keeps_what_it_must() -> None:
    for name in list_packaged_suites().keys() - {"mdrive"}:  # of which test_mdrive_suite is
        assert find_suite_problems(load_suite(name), ()) == ()
