"""The adversarial search: the same whatever the order of evaluation, interruption or budget; and what it chooses."""

import json
import random
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pytest
from testing.local_executor import LocalExecutor
from testing.toy_family import TOY, TOY_FAMILY, evaluate_by_formula, load_toy_source, make_check

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.duplicates import find_duplicate
from mdrive_sumo.generate.hard import adversarial_search, families, hard_selection
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings, run_search
from mdrive_sumo.generate.hard.archive_file import HardArchiveFile, build_archive_file
from mdrive_sumo.generate.hard.behaviour_archive import BATCH, DESCRIPTORS, SearchSeed, find_cell
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures, CandidateTask
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
from mdrive_sumo.runs.worker_process import WorkerFailure

pytestmark = pytest.mark.slow  # pyribs: four seconds of imports

J = TypeVar("J")
R = TypeVar("R")
BUDGET = 5 * BATCH


class ShuffledExecutor(LocalExecutor[J, R]):
    """Runs four jobs at once and returns them in another order."""

    @property
    def free_slots(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return 4 - len(self._done)

    def collect_outcomes(self, *_: object) -> list[tuple[str, R | WorkerFailure]]:
        done, self._done = self._done, []
        random.Random(len(done)).shuffle(done)
        return done


class Silent:
    """A SearchProgress that stops the search after so many evaluations."""

    def __init__(self, stop_after: int = 10**9) -> None:
        self.left = stop_after

    def begin(self, total: int, kept: int) -> None: ...

    def note(self, text: str) -> None: ...

    def evaluated(self, evaluation: CandidateEvaluation) -> None:
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(families, "FAMILIES", {TOY: TOY_FAMILY})
    monkeypatch.setattr(adversarial_search, "evaluate_candidate", evaluate_by_formula)
    monkeypatch.setattr(adversarial_search, "ProcessPool", LocalExecutor)
    monkeypatch.setattr(hard_selection, "ProcessPool", LocalExecutor)


def settings(budget: int = BUDGET, seed: int = 0) -> SearchSettings:
    return SearchSettings((TOY_FAMILY,), budget, SearchSeed(seed), 1)


def searched(
    folder: Path, chosen: SearchSettings | None = None, progress: Silent | None = None, **more: Any
) -> HardArchiveFile:
    chosen = chosen or settings()
    with open_journal(folder, chosen.fingerprint, fresh=False) as journal:
        return build_archive_file(run_search(chosen, SearchJournal(journal), progress or Silent(), **more))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[HardArchiveFile]:
    """The archive of an uninterrupted search."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adversarial_search, "evaluate_candidate", evaluate_by_formula)
        patch.setattr(adversarial_search, "ProcessPool", LocalExecutor)
        yield searched(tmp_path_factory.mktemp("whole"))


def test_the_archive_holds_the_best_candidate_of_every_cell(whole: HardArchiveFile, tmp_path: Path) -> None:
    with open_journal(tmp_path, settings().fingerprint, fresh=False) as journal:
        (search,) = run_search(settings(), SearchJournal(journal), Silent())
    best: dict[tuple[int, ...], float] = {}
    for one in search.evaluations:
        if one.figures is not None:
            cell = find_cell(one.figures)
            best[cell] = max(best.get(cell, 0.0), round(one.figures.gap, 3))
    (archive,) = whole.families
    assert {elite.cell: elite.gap for elite in archive.elites} == best
    assert archive.evaluated == BUDGET == len(search.evaluations) and archive.rejected["build"] > 0
    values = [one.values for one in search.evaluations]
    assert len(set(values)) == BUDGET and all(0 <= a <= 10 and 0 <= b <= 30 for a, b in values)


def test_later_candidates_are_better(tmp_path: Path) -> None:
    """The objective of the formula grows along one parameter: variation of certified elites finds its end."""
    with open_journal(tmp_path, settings(80).fingerprint, fresh=False) as journal:
        (search,) = run_search(settings(80), SearchJournal(journal), Silent())
    gaps = [
        one.figures.gap if one.figures is not None and one.figures.is_certified else 0.0 for one in search.evaluations
    ]
    assert max(gaps) > max(gaps[:16]) > 0.0


def test_later_candidates_are_bred_from_certified_ones(tmp_path: Path) -> None:
    with open_journal(tmp_path, settings(80).fingerprint, fresh=False) as journal:
        (search,) = run_search(settings(80), SearchJournal(journal), Silent())
    passed = [
        [one.figures for one in part if one.figures is not None]
        for part in (search.evaluations[:16], search.evaluations[16:])
    ]
    first, later = (sum(one.is_certified for one in part) / len(part) for part in passed)
    assert later > max(first, 0.8)


def test_the_order_of_evaluation_changes_nothing(
    whole: HardArchiveFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adversarial_search, "ProcessPool", ShuffledExecutor)
    assert searched(tmp_path) == whole


@pytest.mark.parametrize("stop", [1, BATCH, 2 * BATCH + 3])
def test_an_interrupted_search_continues_to_the_same_archive(whole: HardArchiveFile, tmp_path: Path, stop: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        searched(tmp_path, progress=Silent(stop))
    rest = Silent()
    assert searched(tmp_path, progress=rest) == whole
    assert rest.left == 10**9 - (BUDGET - stop)


def test_a_larger_budget_continues_and_what_is_kept_can_be_used_alone(whole: HardArchiveFile, tmp_path: Path) -> None:
    few = searched(tmp_path, settings(BATCH + 1))
    assert few.families[0].evaluated == 2 * BATCH
    with pytest.raises(KeyboardInterrupt):
        searched(tmp_path, progress=Silent(3))
    kept = searched(tmp_path, only_kept=True).families[0]
    assert kept.evaluated == few.families[0].evaluated + 3 and len(kept.elites) >= len(few.families[0].elites)
    assert searched(tmp_path) == whole


def test_another_seed_or_secret_makes_other_candidates(tmp_path: Path, whole: HardArchiveFile) -> None:
    public = {elite.id for elite in whole.families[0].elites}
    hidden = SearchSettings((TOY_FAMILY,), BATCH, SearchSeed(0, "hidden", "battery horse staple"), 1)
    for i, one in enumerate((settings(BATCH, 1), hidden)):
        assert not public & {elite.id for elite in searched(tmp_path / str(i), one).families[0].elites}
    assert all(e.id.startswith("toy_h") for e in searched(tmp_path / "1", hidden).families[0].elites)
    assert "battery" not in (tmp_path / "1" / "journal.jsonl").read_text()


def test_a_journal_of_another_search_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched(tmp_path, settings(BATCH))
    with pytest.raises(InputError, match="found one with another seed 0 \\(now 3\\); --fresh starts anew"):
        searched(tmp_path, settings(BATCH, 3))
    changed = TOY_FAMILY.parameters[0].__class__("start", 0.0, 5.0, "m", "")
    family = TOY_FAMILY.__class__(TOY, "", (changed, TOY_FAMILY.parameters[1]), TOY_FAMILY.build)
    with pytest.raises(InputError, match="its family or the search has changed since; --fresh starts anew"):
        searched(tmp_path, SearchSettings((family,), BATCH, SearchSeed(), 1))


def test_a_candidate_without_result_is_rejected_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(task: CandidateTask) -> CandidateEvaluation:
        raise RuntimeError("broken")

    monkeypatch.setattr(adversarial_search, "evaluate_candidate", fail)
    assert searched(tmp_path, settings(BATCH)).families[0].rejected == {"failure": BATCH}


@pytest.mark.parametrize("descriptor", DESCRIPTORS)
def test_cells_lie_between_their_edges(descriptor: Any) -> None:
    assert len(descriptor.edges) == descriptor.cells + 1
    assert descriptor.edges[0] == pytest.approx(descriptor.low) and descriptor.edges[-1] == pytest.approx(
        descriptor.high
    )
    for i, (low, high) in enumerate(zip(descriptor.edges, descriptor.edges[1:], strict=False)):
        assert descriptor.find_cell((low + high) / 2) == i
    assert (descriptor.find_cell(-1.0), descriptor.find_cell(1e6)) == (0, descriptor.cells - 1)


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
        with open_journal(tmp_path, settings().fingerprint, fresh=False) as journal:
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


def test_the_archive_file_can_be_read_again(whole: HardArchiveFile) -> None:
    assert HardArchiveFile.model_validate(json.loads(whole.model_dump_json())) == whole
