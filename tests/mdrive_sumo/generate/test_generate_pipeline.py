"""The generator's stages: each refuses under its own name, whatever is proposed; the search that puts them in a row."""

import random
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.generate import generation_search, pipeline
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.generated_suite import load_packaged_generated, write_generated_suite
from mdrive_sumo.generate.generation_search import MAX_TRIES, WEATHER, GenerationAttempt, GenerationRequest
from mdrive_sumo.generate.pipeline import build_scenario, screen_candidate
from mdrive_sumo.generate.proposal import EgoVehicle, Proposal
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.generate.screening import ScreeningResult
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from mdrive_sumo.worlds.encounters.proposed_actor import ProposedActor
from tests.mdrive_sumo.generate.test_generate_rules import deadlock, ego, other, relation

GOOD = ScreeningResult(0.3, 100.0)


def made(proposal: Proposal, seed: str = "1") -> Scenario:
    return build_scenario(Recipe(id="made", seed=seed, proposal=proposal))


def refused(action: Callable[[], object]) -> tuple[PipelineStage, str]:
    with pytest.raises(ProposalRejected) as caught:
        action()
    return caught.value.stage, caught.value.reason


def screening(monkeypatch: pytest.MonkeyPatch, found: ScreeningResult | Exception) -> None:
    """Instead of driving, so much is found."""

    def screen(*_: object) -> ScreeningResult:
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(pipeline, "screen_scenario", screen)


TOO_SHORT_FOR_A_CHANGE = other(
    "roundabout",
    ego_vehicles=[ego(1, "left"), ego(2), ego(3, "lane_change"), ego(4)],
    vehicle_constraints=[
        relation(2, "perpendicular_left_of", 1),
        relation(3, "opposite_approach_of", 1),
        relation(4, "follow_route_of", 2),
    ],
)


def _no_place_for_a_van() -> Scenario:
    """Of the pre-crash templates, the first that finds none."""
    order = GenerationRequest(Category.PRE_CRASH, 1, 19)
    proposal = propose(Category.PRE_CRASH, random.Random(f"{order.attempt_seed(0)}/proposal"))
    return made(proposal, order.attempt_seed(0))


@pytest.mark.parametrize(
    ("stage", "action", "reason"),
    [
        (
            PipelineStage.RULES,
            lambda: made(deadlock(topology="corridor")),
            "topology: expected intersection for deadlock",
        ),
        (
            PipelineStage.SPAWNS,
            lambda: made(TOO_SHORT_FOR_A_CHANGE, "1092"),
            "expected at least 1 m to change lanes in, found",
        ),
        (PipelineStage.ACTORS, _no_place_for_a_van, "actor van_1: expected room for a van at the kerb, found none"),
    ],
)
def test_what_cannot_be_built_is_refused_where_it_fails(
    stage: PipelineStage, action: Callable[[], Scenario], reason: str
) -> None:
    found, told = refused(action)
    assert found is stage
    assert reason in told


def test_cavs_that_start_inside_each_other_are_refused_before_anything_is_driven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screening(monkeypatch, AssertionError("driven"))
    scenario = made(deadlock())
    first, second, *more = scenario.egos
    crowded = scenario.model_copy(update={"egos": (first, second.model_copy(update={"start": first.start}), *more)})
    stage, reason = refused(lambda: screen_candidate(crowded, ()))
    assert stage is PipelineStage.SOUNDNESS
    assert reason.startswith(
        "expected no overlapping boxes at the start, found that CAV 0 and CAV 1 start inside each other"
    )


def test_a_twin_is_refused_before_anything_is_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    screening(monkeypatch, AssertionError("driven"))
    scenario = made(deadlock())
    twin = scenario.model_copy(update={"id": "twin"})
    found = refused(lambda: screen_candidate(scenario, (twin,)))
    assert found == (PipelineStage.DUPLICATES, "expected something new, found a duplicate of twin")


@pytest.mark.parametrize(
    ("found", "stage", "reason"),
    [
        (ScreeningResult(None, 0.0), PipelineStage.DIFFICULTY, "expected a blind TTC below 0.9 s, found none"),
        (ScreeningResult(0.94, 0.0), PipelineStage.DIFFICULTY, "expected a blind TTC below 0.9 s, found 0.94 s"),
        (ScreeningResult(0.1, 64.0), PipelineStage.FEASIBILITY, "expected omniscient to reach DS 100, found 64.00"),
        (WorldError("no lane"), PipelineStage.FEASIBILITY, "expected an episode, found none: no lane"),
    ],
)
def test_what_is_found_by_driving_decides(
    found: ScreeningResult | Exception, stage: PipelineStage, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    screening(monkeypatch, found)
    scenario = made(deadlock())
    assert refused(lambda: screen_candidate(scenario, ())) == (stage, reason)
    screening(monkeypatch, GOOD)
    assert screen_candidate(scenario, ()) is GOOD


@st.composite
def proposals(draw: st.DrawFn) -> Proposal:
    """Templates in which vehicles do something else and other actors stand about: what a language model may say."""
    template = propose(draw(st.sampled_from(Category)), random.Random(draw(st.integers(0, 10**6))))
    names = st.sampled_from([vehicle.vehicle_id for vehicle in template.ego_vehicles])
    number = st.integers(1, 8)
    actors = [
        draw(st.builds(ProposedActor, actor_id=st.just(f"more_{n}"), affects_vehicle=names, quantity=number))
        for n in range(draw(st.integers(0, 3)))
    ]
    egos = [
        draw(st.one_of(st.just(vehicle), st.builds(EgoVehicle, vehicle_id=st.just(vehicle.vehicle_id))))
        for vehicle in template.ego_vehicles
    ]
    return template.model_copy(update={"ego_vehicles": tuple(egos), "actors": (*template.actors, *actors)})


@pytest.mark.slow
@settings(max_examples=examples(15, 60))
@given(proposals(), st.integers(0, 10**6))
def test_whatever_is_proposed_becomes_a_scenario_or_is_refused_with_a_reason(proposal: Proposal, seed: int) -> None:
    try:
        scenario = made(proposal, str(seed))
    except ProposalRejected as rejected:
        assert (rejected.stage is PipelineStage.RULES) == bool(find_rule_violations(proposal))
        assert "expected" in rejected.reason or "cannot be both" in rejected.reason
        assert "\n" not in rejected.reason
    else:
        assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


def searched(
    monkeypatch: pytest.MonkeyPatch, found: ScreeningResult | Exception, *known: Scenario, count: int = 10
) -> Sequence[GenerationAttempt]:
    screening(monkeypatch, found)
    return list(generation_search.search_scenarios(GenerationRequest(Category.DEADLOCK, count), known=known))


@pytest.mark.slow
def test_of_ten_scenarios_three_are_cloudy_three_by_night_two_clear_and_two_in_rain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = [attempt.scenario for attempt in searched(monkeypatch, GOOD)[:3] if attempt.scenario]
    attempts = searched(monkeypatch, GOOD, *known)
    weather = [attempt.scenario.weather for attempt in attempts if attempt.scenario]
    assert tuple(weather) == WEATHER
    assert Counter(weather) == {"cloudy": 3, "night": 3, "default": 2, "rain": 2}
    twins = {attempt.rejection for attempt in attempts if attempt.rejection and attempt.rejection[0] == "duplicates"}
    assert {reason.rpartition(" ")[2] for _, reason in twins} >= {scenario.id for scenario in known}


def explained(out: Path, *more: str) -> list[str]:
    """What is printed of an order for one scenario."""
    call = ("generate", "--category", "deadlock", "--count", "1", "--explain", "--out", str(out))
    return CliRunner().invoke(main, (*call, *more)).output.splitlines()


def twin_of(name: str, number: int = 0) -> str:
    return f"proposal {number}: refused at duplicates: expected something new, found a duplicate of {name}"


def test_what_is_packaged_is_not_made_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    screening(monkeypatch, GOOD)
    first = next(generation_search.search_scenarios(GenerationRequest(Category.DEADLOCK, 1)))
    assert first.recipe is not None and first.scenario is not None
    write_generated_suite(SuiteFile(name="own", title="Generated"), [(first.recipe, first.scenario)], tmp_path / "own")
    save_suite(Suite(SuiteFile(name="foreign", title="Not"), tmp_path / "foreign", (made(deadlock()),)))
    folders = {name: tmp_path / name for name in ("own", "foreign")}
    monkeypatch.setattr("mdrive_sumo.generate.generated_suite.list_exact_suites", lambda: folders)
    assert [scenario.id for scenario in load_packaged_generated()] == [first.scenario.id]
    assert explained(tmp_path / "new")[0] == twin_of(first.scenario.id)


@pytest.mark.slow
def test_hidden_scenarios_are_held_against_what_may_be_public(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    screening(monkeypatch, GOOD)
    order = GenerationRequest(Category.DEADLOCK, 1, split="hidden", secret="0123456789abcdef")
    first = next(attempt for attempt in generation_search.search_scenarios(order) if attempt.scenario)
    assert first.scenario is not None
    public = [first.scenario.model_copy(update={"id": "public"})]

    def counterparts(of: GenerationRequest) -> list[Scenario]:
        assert of == order
        return public

    monkeypatch.setattr("mdrive_sumo.cli.generate.build_public_counterparts", counterparts)
    (tmp_path / "seed").write_text("0123456789abcdef")
    said = explained(tmp_path / "new", "--split", "hidden", "--seed-file", str(tmp_path / "seed"))
    assert said[first.number] == twin_of("public", first.number)


@pytest.mark.slow
def test_the_search_gives_up_after_so_many_proposals(monkeypatch: pytest.MonkeyPatch) -> None:
    attempts = searched(monkeypatch, ScreeningResult(None, 0.0), count=2)
    assert len(attempts) == 2 * MAX_TRIES
    assert all(attempt.scenario is None and attempt.rejection for attempt in attempts)


@pytest.mark.parametrize(
    "changed", [{"seed": 6}, {"category": Category.CROSSWALK}, {"split": "hidden", "secret": "s" * 16}]
)
def test_every_attempt_of_every_order_has_a_seed_of_its_own(changed: dict[str, object]) -> None:
    order = GenerationRequest(Category.DEADLOCK, 10, 5)
    changed_order = GenerationRequest(**({"category": Category.DEADLOCK, "count": 10, "seed": 5} | changed))
    seeds = [one.attempt_seed(number) for one in (order, changed_order) for number in range(50)]
    assert len(set(seeds)) == 100
    assert len({order.scenario_id(0), changed_order.scenario_id(0)}) == 2


def test_the_count_does_not_change_what_comes_first() -> None:
    assert GenerationRequest(Category.DEADLOCK, 1).attempt_seed(0) == GenerationRequest(
        Category.DEADLOCK, 9
    ).attempt_seed(0)
