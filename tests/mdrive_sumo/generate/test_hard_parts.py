"""Parts of the hard tier: factor of the time limits, places of families, proposals, met controls, the first edition."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from testing.toy_family import CROSSING, TOY_FAMILY, evaluate_by_formula, make_figures

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard import family_search
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateTask
from mdrive_sumo.generate.hard.candidate_probes import VARIANTS, CandidateProbe, CandidateScores, compute_most_mean
from mdrive_sumo.generate.hard.candidate_rejection import CandidateRejected, RejectionStage
from mdrive_sumo.generate.hard.cautious_drivers import CAUTIOUS_DRIVERS, SPEEDING_DRIVERS
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily, draw_weather
from mdrive_sumo.generate.hard.family_search import AHEAD, FamilySearch
from mdrive_sumo.generate.hard.hard_places import HardPlace, find_places, list_choices, name_choice
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.hard.met_controls import count_met_controls
from mdrive_sumo.generate.hard.time_limits import (
    LEAST_FACTOR,
    MOST_FACTOR,
    choose_limit_factor,
    compute_time_limits,
    find_limit_factor,
    set_time_limits,
)
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.open_agents import AGENTS
from mdrive_sumo.scenario.categories import WEATHER_OF_TEN
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.worlds.places import PLACES_VERSION
from mdrive_sumo.worlds.places.place_files import PlaceFile

ROUNDABOUT = PlaceChoice("roundabout", {"arms": 4})


def make_place(choice: PlaceChoice, number: int) -> HardPlace:
    about = PlaceFile(version=PLACES_VERSION, kind=choice.kind, seed=number, parameters={})
    return HardPlace(about, name_choice(choice), Path(f"{choice.kind}_{number}"))


POOL = tuple(make_place(choice, k) for choice in (ROUNDABOUT, CROSSING) for k in range(3))


@pytest.mark.parametrize(
    ("cautious", "factor"),
    [
        ({}, 1.5),  # nobody is hidden
        ({"0": 8.01}, 1.5),  # 4 s x 1.5 + 2 s is 8 s
        ({"0": 8.0}, 1.45),
        ({"0": 6.61}, 1.15),
        ({"0": 6.6}, 1.5),  # also the least factor gives 6.6 s: no certificate, so the usual limit
        ({"0": None}, 1.5),
        ({"0": 6.61, "1": 9.3}, 1.45),  # one CAV is enough
    ],
)
def test_the_factor_is_the_greatest_that_a_cautious_driver_misses(
    cautious: dict[str, float | None], factor: float
) -> None:
    assert choose_limit_factor({"0": 80, "1": 100}, cautious) == factor


@given(
    st.dictionaries(st.sampled_from("abc"), st.integers(1, 2000), min_size=1),
    st.dictionaries(st.sampled_from("abc"), st.one_of(st.none(), st.floats(0.0, 300.0))),
)
def test_a_factor_is_within_its_bounds_and_no_greater_one_proves_more(
    ticks: dict[str, int], cautious: dict[str, float | None]
) -> None:
    known = {name: time for name, time in cautious.items() if name in ticks}
    factor = choose_limit_factor(ticks, known)
    assert LEAST_FACTOR <= factor <= MOST_FACTOR

    def is_missed(factor: float) -> bool:
        limits = compute_time_limits(ticks, factor)
        return any(time is None or time > limits[name] for name, time in known.items())

    greater = [round(factor + 0.05 * k, 2) for k in range(1, 8) if factor + 0.05 * k < MOST_FACTOR + 0.01]
    assert not any(map(is_missed, greater))
    assert is_missed(factor) or not is_missed(LEAST_FACTOR)


def test_limits_of_another_factor_or_of_none_are_found() -> None:
    scenario = load_suite("hard@0").scenarios[0]
    ticks = {ego.id: 100 + 7 * k for k, ego in enumerate(scenario.egos)}
    for factor in (1.15, 1.3, 1.5):
        assert find_limit_factor(set_time_limits(scenario, compute_time_limits(ticks, factor)), ticks) == factor
    assert find_limit_factor(set_time_limits(scenario, compute_time_limits(ticks, 1.6)), ticks) is None
    mixed = {**compute_time_limits(ticks, 1.3), scenario.egos[0].id: 9.999}
    assert find_limit_factor(set_time_limits(scenario, mixed), ticks) is None


def test_a_family_gets_the_places_that_it_asks_for_kind_by_kind() -> None:
    both = ScenarioFamily("both", "", (CROSSING, ROUNDABOUT, CROSSING), (), TOY_FAMILY.stage)
    assert [place.name for place in find_places(POOL, TOY_FAMILY)] == ["crossing_0", "crossing_1", "crossing_2"]
    assert [place.name for place in find_places(POOL, both)][:3] == ["crossing_0", "roundabout_0", "crossing_1"]
    assert list_choices((TOY_FAMILY, both)) == (CROSSING, ROUNDABOUT)
    with pytest.raises(InputError, match=r"family: places: expected one of crossing, .*found 'crosing'"):
        list_choices((ScenarioFamily("bad", "", (PlaceChoice("crosing"),), (), TOY_FAMILY.stage),))


def run_candidates(search: FamilySearch, count: int) -> list[FamilyCandidate]:
    """Propose and record candidates as the search does: the next one when all but the last `AHEAD` are recorded."""
    made: list[FamilyCandidate] = []
    while len(made) < count:
        made.append(search.propose())
        if len(made) >= AHEAD:
            oldest = made[len(made) - AHEAD]
            search.record(evaluate_by_formula(CandidateTask(search.family, oldest, POOL[0])))
    return made


def test_proposals_are_the_same_again_and_children_stand_on_the_places_of_their_parents() -> None:
    places = find_places(POOL, TOY_FAMILY)
    one, other = (run_candidates(FamilySearch(TOY_FAMILY, places, SeasonSeed(3)), 96) for _ in range(2))
    assert one == other
    assert [candidate.place for candidate in one[:4]] == ["crossing_0", "crossing_1", "crossing_2", "crossing_0"]
    assert run_candidates(FamilySearch(TOY_FAMILY, places, SeasonSeed(4)), 96) != one
    bred = one[AHEAD:]
    assert all(0.0 <= candidate.values[0] <= 10.0 for candidate in bred)
    assert sum(candidate.values[0] <= 8.0 for candidate in bred) > 0.8 * len(bred)  # a fifth of random ones is refused
    assert len({candidate.place for candidate in bred}) == 3


def test_children_avoid_a_place_on_which_nothing_passes_and_spread_over_the_others() -> None:
    places = find_places(POOL, TOY_FAMILY)
    search = FamilySearch(TOY_FAMILY, places, SeasonSeed(3))
    made = Counter[str]()
    for number in range(80):
        candidate = search.propose()
        made[candidate.place] += number >= family_search.FIRST_CANDIDATES
        passes = candidate.place != places[0].name
        update = {"stage": None, "figures": make_figures("toy_1", 70.0, 30.0)} if passes else {"rejected_score": 70.0}
        search.record(_reject(candidate).model_copy(update={"stage": RejectionStage.UNAIDED} | update))
    bad, *good = (made[place.name] for place in places)
    assert 0 < bad < 0.6 * min(good)
    assert max(good) - min(good) <= 6


def _end_search(update: Mapping[str, object]) -> int:
    """Return after how many candidates a family ends whose evaluations are all alike."""
    search = FamilySearch(TOY_FAMILY, find_places(POOL, TOY_FAMILY), SeasonSeed(3))
    while not search.is_over:
        search.record(_reject(search.propose()).model_copy(update=update))
    return len(search.evaluations)


def test_a_family_ends_of_which_nothing_is_dangerous_or_passes_or_of_which_there_is_enough() -> None:
    assert _end_search({}) == family_search.GIVE_UP
    assert _end_search({"stage": RejectionStage.UNAIDED, "rejected_score": 70.0}) == family_search.GIVE_UP_WITHOUT_PASS
    assert _end_search({"stage": None, "figures": make_figures("toy_1", 70.0, 30.0)}) == family_search.ENOUGH
    assert FamilySearch(TOY_FAMILY, (), SeasonSeed(3)).is_over


def _reject(candidate: FamilyCandidate) -> CandidateEvaluation:
    return CandidateEvaluation(
        id=candidate.scenario_id,
        family="toy",
        place=candidate.place,
        values=candidate.values,
        seed=candidate.seed,
        stage=RejectionStage.DANGER,
    )


def test_merit_ranks_what_agents_without_messages_lose() -> None:
    blank = _reject(FamilyCandidate("toy_1", "crossing_0", (1.0, 0.0), "s"))
    passed = [blank.model_copy(update={"figures": make_figures("toy_1", 70.0, score)}) for score in (40.0, 20.0)]
    stages = ((RejectionStage.UNAIDED, 90.0), (RejectionStage.UNAIDED, 70.0), (RejectionStage.GAP, 99.0))
    near = [blank.model_copy(update={"stage": stage, "rejected_score": score}) for stage, score in stages]
    ranked = [one.merit for one in (blank, *near, *passed)]
    assert ranked == sorted(ranked) and len(set(ranked)) == len(ranked)


def test_the_mean_of_the_first_variants_may_be_above_the_bound_by_two_standard_errors() -> None:
    bounds = [compute_most_mean(count) for count in range(1, len(VARIANTS) + 1)]
    assert bounds[0] == pytest.approx(45.0 + 2 * 15.0 * math.sqrt(12 / 13))
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] == 45.0


def drive_variants(monkeypatch: pytest.MonkeyPatch, scores: Mapping[str, float]) -> list[str]:
    """Return the names of the variants that are driven when they have these scores (30 where none is named)."""
    driven: list[str] = []

    def drive(self: CandidateScores, probes: Sequence[CandidateProbe], _seeds: Sequence[int]) -> None:
        for probe in probes:
            driven.append(probe.name)
            self._scores[probe.name] = [scores.get(probe.name, 30.0)]

    monkeypatch.setattr(CandidateScores, "drive", drive)
    found = CandidateScores(
        load_suite("hard@0").scenarios[0], load_road_map(find_network_folder("hard_roundabout")), {}
    )
    with suppress(CandidateRejected):
        found.drive_variants()
    return driven


def test_variants_are_driven_until_their_mean_is_too_great(monkeypatch: pytest.MonkeyPatch) -> None:
    names = [variant.name for variant in VARIANTS]
    assert sorted(drive_variants(monkeypatch, {})) == sorted(names)
    assert len(drive_variants(monkeypatch, dict.fromkeys(names, 80.0))) == 1
    assert len(drive_variants(monkeypatch, dict.fromkeys(names, 60.0))) == 4  # after three 60.2 is the bound
    assert len(drive_variants(monkeypatch, dict.fromkeys(names, 46.0))) == len(names)


def test_weather_comes_from_the_seed_as_often_as_in_interaction() -> None:
    drawn = [draw_weather(str(k)) for k in range(400)]
    assert drawn == [draw_weather(str(k)) for k in range(400)]
    for name, of_ten in WEATHER_OF_TEN.items():
        assert drawn.count(name) == pytest.approx(40 * of_ten, abs=30)  # three standard deviations


def test_the_drivers_without_messages_are_ten_cautious_ones_and_three_that_speed() -> None:
    assert (len(CAUTIOUS_DRIVERS), len(SPEEDING_DRIVERS)) == (10, 3)
    drivers = (*CAUTIOUS_DRIVERS, *SPEEDING_DRIVERS)
    assert len({one.name for one in drivers}) == len({str((one.agent, one.config)) for one in drivers}) == 13
    for one in drivers:
        AGENTS[one.agent](one.config)


def test_routes_that_meet_a_sign_or_running_lights_are_counted() -> None:
    suite = load_suite("hard@0")
    scenario = next(one for one in suite.scenarios if one.network == "hard_corridor_narrow")
    roads = load_road_map(find_network_folder(scenario.network))
    lights = {lane for lane, kind in roads.junction_controls.items() if kind == "traffic-light"}
    passing = [any(lane in lights for lane in ego.lanes[1:]) for ego in scenario.egos]
    frozen = scenario.model_copy(update={"signals": "frozen-green"})
    running = scenario.model_copy(update={"signals": "program"})
    assert count_met_controls(running, roads) - count_met_controls(frozen, roads) <= sum(passing)
    assert count_met_controls(running, roads) >= sum(passing)


def test_the_first_edition_is_not_rebuilt_and_the_error_says_by_what() -> None:
    result = CliRunner().invoke(main, ["generate", "--rebuild", "hard@0"])
    assert result.exit_code == 2
    assert f"expected version {HARD_GENERATOR} of the families of the hard tier, found 3" in result.output
    assert "commit a14fdf0a" in result.output and result.output.count("\n") == 1
