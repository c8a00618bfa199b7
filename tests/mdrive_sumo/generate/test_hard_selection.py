"""What the hard tier chooses of the candidates that a search found: aims, no duplicates, checks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from testing.local_executor import LocalExecutor
from testing.toy_family import TOY, TOY_FAMILY, load_toy_source, make_check, make_scores

from mdrive_sumo.generate.duplicates import find_duplicate
from mdrive_sumo.generate.hard import families, hard_selection
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings
from mdrive_sumo.generate.hard.behaviour_archive import SearchSeed
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures
from mdrive_sumo.generate.hard.candidate_probes import BOTH, SINGLE, WAITING
from mdrive_sumo.generate.hard.elite_check import CHECK_SEEDS, EliteCheck, EliteTask, describe_check
from mdrive_sumo.generate.hard.hard_selection import (
    ChosenElite,
    SelectionSettings,
    build_pool,
    select_checked_elites,
    select_elites,
)
from mdrive_sumo.generate.hard.suite_aims import build_aims, compute_interval, find_missed_aims
from mdrive_sumo.generate.hard.time_limits import compute_time_limit_s
from mdrive_sumo.runs.journal import open_journal

pytestmark = pytest.mark.slow  # pyribs: four seconds of imports
Elite = CandidateEvaluation


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY})
    monkeypatch.setattr(hard_selection, "ProcessPool", LocalExecutor)


def test_the_time_limit() -> None:
    assert compute_time_limit_s(200) == 17.0  # 1.5 x 10 s + 2 s


WALKERS = (0.0, 1.0, 3.0, 8.0, 21.0)
"""Numbers of pedestrians of scenarios that are no duplicates."""
FIGURES: dict[str, Any] = {
    "network": "town_crossing",
    "road_users": 2,
    "mean_speed": 5.0,
    "message_gain_s": 1.0,
    "is_certified": True,
}


def make_elites(count: int, name: str = TOY, scores: dict[str, float] | None = None, **figures: Any) -> list[Elite]:
    """Elites without drives; rules that talk from 40 to 90, and those without messages from 25 to 50."""
    return [
        CandidateEvaluation(
            id=f"{name}_{i}",
            family=TOY,
            values=(8.0 * (i % 2), WALKERS[i // 2 % len(WALKERS)]),
            seed="s",
            figures=CandidateFigures(
                reference_ticks={find_cav(): 60},
                scores=scores or make_scores(40.0 + 50.0 * i / count, 25.0 + 25.0 * (i * 7 % count) / count),
                **{**FIGURES, **figures},
            ),
        )
        for i in range(count)
    ]


def find_cav() -> str:
    """Return the id of the toy's CAV."""
    return next(one for one in load_toy_source() if one.id == "i07_ins_ss_town").egos[0].id


def choose(candidates: Sequence[Elite], count: int) -> tuple[ChosenElite, ...]:
    return select_elites(build_pool(candidates), {one.id for one in candidates}, count)


def test_of_equal_elites_the_one_is_chosen_in_which_waiting_scores_least() -> None:
    easy, lost = (
        make_elites(1, name, make_scores(60.0, **{WAITING: w})) for name, w in (("easy", 50.0), ("lost", 5.0))
    )
    (chosen,) = choose([*easy, *lost], 1)
    assert chosen.evaluation.id == "lost_0"


def mean_of(chosen: Sequence[ChosenElite], name: str) -> float:
    return sum(one.evaluation.measured.scores[name] for one in chosen) / len(chosen)


def test_a_selection_meets_the_aims() -> None:
    plain = make_elites(40, scores=None, is_certified=True)
    on_corridor = make_elites(20, "corridor", network="hard_corridor_x", is_certified=False)
    candidates = [*plain, *on_corridor]
    chosen = choose(candidates, 6)
    assert len(chosen) == 6
    assert sum(one.evaluation.measured.is_certified for one in chosen) == 4
    assert mean_of(chosen, BOTH) <= 74.0 and mean_of(chosen, SINGLE) <= 39.0
    evaluations = [one.evaluation for one in chosen]
    missed = list(find_missed_aims(evaluations, 6))
    assert [one.partition(":")[0] for one in missed] == [
        "mean of take-turns",
        "single above constant-speed",
        "sharing+negotiation above sharing",
        "categories",
        f"category {TOY}",
    ]
    scenarios = [one.scenario for one in chosen]
    assert all(find_duplicate(one, scenarios[:i]) is None for i, one in enumerate(scenarios))
    assert [ego.time_limit_s for ego in scenarios[0].egos] == [compute_time_limit_s(60)]
    assert chosen == choose(candidates[::-1], 6)


def test_what_a_choice_misses_is_told_with_figures() -> None:
    scores = {"single": 45.0, "sharing": 80.0, BOTH: 85.0, "omniscient": 96.0, WAITING: 12.0, "constant-speed": 20.0}
    poor = make_elites(3, scores=make_scores(0.0, **scores), is_certified=False)
    assert list(find_missed_aims(poor, 4)) == [
        "scenarios: expected 4, found 3",
        "mean of single: expected 40 at most, found 45",
        "mean of sharing: expected 75 at most, found 80",
        "mean of sharing+negotiation: expected 75 at most, found 85",
        "mean of omniscient: expected 97 at least, found 96",
        "share of dense corridors: expected 0.3333 at least, found 0",
        "share of certificates: expected 0.6667 at least, found 0",
        "categories: expected 10 with 2 scenarios or more, found 1",
        f"category {TOY}: expected 1 scenarios at most, found 3",
    ]
    assert list(find_missed_aims([], 4)) == ["scenarios: expected 4, found 0"]


def test_the_interval_of_a_paired_difference() -> None:
    mean, half = compute_interval([1.0, 2.0, 3.0, 6.0])
    assert mean == 3.0 and half == pytest.approx(1.96 * (14.0 / 3.0) ** 0.5 / 2.0)
    assert compute_interval([1.0]) == (1.0, float("inf"))


def test_certificates_are_a_number_of_large_suites_and_a_share_of_small_ones() -> None:
    shares = [next(a for a in build_aims(n) if a.name == "share of certificates").bound for n in (6, 120, 160)]
    assert shares == pytest.approx([2 / 3, 2 / 3, 0.5])


def test_a_selection_without_enough_elites_is_smaller() -> None:
    few = make_elites(4, is_certified=False)
    assert {one.evaluation.id for one in choose(few, 12)} == {one.id for one in few}
    twins = [one.model_copy(update={"id": f"twin_{one.id}"}) for one in few]
    assert len(choose([*few, *twins], 12)) == 4


def test_an_elite_that_fails_the_check_is_replaced_by_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    driven: list[str] = []

    def check(task: EliteTask) -> EliteCheck:
        driven.append(task.scenario.id)
        return make_check(task.scenario.id, *([100.0, 65.0] if len(driven) == 1 else [100.0] * task.seeds))

    monkeypatch.setattr(hard_selection, "check_elite", check)
    notes: list[str] = []
    for _ in range(2):
        with open_journal(
            tmp_path, SearchSettings((TOY_FAMILY,), 8, SearchSeed(), 1).fingerprint, fresh=False
        ) as journal:
            chosen = select_checked_elites(
                make_elites(9), SelectionSettings(4, 1), SearchJournal(journal), notes.append
            )
        assert len(chosen) == 4 and driven[0] not in {one.scenario.id for one in chosen}
        assert len(driven) == len(set(driven)) >= 5  # the second time, the journal has all of them
    assert any("replaced: seed 1: omniscient 65.00" in note for note in notes)


def test_descriptions_of_checks() -> None:
    solved = make_check("a", *[100.0] * CHECK_SEEDS)
    assert describe_check(solved) == "omniscient 100 with 5 of 5 seeds"
    assert describe_check(EliteCheck(id="a", seeds=5, scores=(100.0,), reason="void")) == "replaced: seed 1: void"
