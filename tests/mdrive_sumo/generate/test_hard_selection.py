"""What the hard tier chooses of the candidates that a search found: shares, mean score, no duplicates, checks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from testing.local_executor import LocalExecutor
from testing.toy_family import TOY, TOY_FAMILY, load_toy_source, make_check

from mdrive_sumo.generate.duplicates import find_duplicate
from mdrive_sumo.generate.hard import families, hard_selection
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings
from mdrive_sumo.generate.hard.behaviour_archive import SearchSeed
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures
from mdrive_sumo.generate.hard.elite_check import CHECK_SEEDS, EliteCheck, EliteTask, describe_check
from mdrive_sumo.generate.hard.hard_selection import (
    ChosenElite,
    SelectionSettings,
    build_pool,
    is_certified,
    is_on_corridor,
    select_checked_elites,
    select_elites,
)
from mdrive_sumo.generate.hard.time_limits import compute_time_limit_s
from mdrive_sumo.runs.journal import open_journal

pytestmark = pytest.mark.slow  # pyribs: four seconds of imports


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY})
    monkeypatch.setattr(hard_selection, "ProcessPool", LocalExecutor)


def test_the_time_limit() -> None:
    assert compute_time_limit_s(200) == 17.0  # 1.5 x 10 s + 2 s


WALKERS = (0.0, 1.0, 3.0, 8.0, 21.0)
"""Numbers of pedestrians of scenarios that are no duplicates."""


def make_elites(count: int, family: str = TOY, **figures: Any) -> list[CandidateEvaluation]:
    """Elites without drives; scores from 0 to 80, every third certified."""
    return [
        CandidateEvaluation(
            id=f"{family}_{i}",
            family=TOY,
            values=(8.0 * (i % 2), WALKERS[i // 2 % len(WALKERS)]),
            seed="s",
            figures=CandidateFigures(
                **{
                    "reference_ticks": {find_cav(): 60},
                    "score": 80.0 * i / count,
                    "unaided_score": 30.0,
                    "network": "hard_corridor_x" if i % 4 == 1 else "town_crossing",
                    "road_users": 2,
                    "mean_speed": 5.0,
                    "message_gain_s": 1.0,
                    "is_certified": i % 3 == 0,
                    **figures,
                }
            ),
        )
        for i in range(count)
    ]


def find_cav() -> str:
    """Return the id of the toy's CAV."""
    return next(one for one in load_toy_source() if one.id == "i07_ins_ss_town").egos[0].id


def share(found: Sequence[CandidateEvaluation], count: int) -> tuple[float, float, float]:
    return (
        sum(map(is_certified, found)) / count,
        sum(map(is_on_corridor, found)) / count,
        sum(one.measured.score for one in found) / count,
    )


def choose(candidates: Sequence[CandidateEvaluation], count: int) -> tuple[ChosenElite, ...]:
    return select_elites(build_pool(candidates), {one.id for one in candidates}, count, 50.0)


def test_of_equal_elites_the_one_is_chosen_that_is_lost_without_messages() -> None:
    alike = {"score": 50.0, "network": "town_crossing", "is_certified": True}
    easy, hopeless = (
        make_elites(1, "easy", unaided_score=50.0, **alike),
        make_elites(1, "lost", unaided_score=5.0, **alike),
    )
    (chosen,) = choose([*easy, *hopeless], 1)
    assert chosen.evaluation.id == "lost_0"


def test_a_selection_has_its_shares_and_its_mean_score() -> None:
    chosen = choose(make_elites(48), 6)
    assert len(chosen) == 6
    certified, corridors, mean = share([one.evaluation for one in chosen], 6)
    assert certified >= 2 / 3 and corridors >= 1 / 3 and mean == pytest.approx(50.0, abs=5.0)
    scenarios = [one.scenario for one in chosen]
    assert all(find_duplicate(one, scenarios[:i]) is None for i, one in enumerate(scenarios))
    assert [ego.time_limit_s for ego in scenarios[0].egos] == [compute_time_limit_s(60)]
    assert chosen == choose(make_elites(48)[::-1], 6)


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
                make_elites(9), SelectionSettings(4, 50.0, 1), SearchJournal(journal), notes.append
            )
        assert len(chosen) == 4 and driven[0] not in {one.scenario.id for one in chosen}
        assert len(driven) == len(set(driven)) >= 5  # the second time, the journal has all of them
    assert any("replaced: seed 1: omniscient 65.00" in note for note in notes)


def test_descriptions_of_checks() -> None:
    solved = make_check("a", *[100.0] * CHECK_SEEDS)
    assert describe_check(solved) == "omniscient 100 with 5 of 5 seeds"
    assert describe_check(EliteCheck(id="a", seeds=5, scores=(100.0,), reason="void")) == "replaced: seed 1: void"
