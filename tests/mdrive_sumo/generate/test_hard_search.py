"""The adversarial search: the same whatever the order of evaluation, interruption or budget."""

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest
from testing.local_executor import LocalExecutor
from testing.toy_family import TOY, TOY_FAMILY, evaluate_by_formula

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard import adversarial_search, families
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings, run_search
from mdrive_sumo.generate.hard.archive_file import HardArchiveFile, build_archive_file
from mdrive_sumo.generate.hard.behaviour_archive import BATCH, DESCRIPTORS, SearchSeed, find_cell
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateTask
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


def test_the_archive_file_can_be_read_again(whole: HardArchiveFile) -> None:
    assert HardArchiveFile.model_validate(json.loads(whole.model_dump_json())) == whole
