"""The adversarial search over families: rounds of one batch a family, evaluated in worker processes.

A journal keeps every evaluated candidate (format, checksums and lock: `runs.journal`). A search that is started again
proposes the same candidates in the same order and takes from the journal what was evaluated before. So an interrupted
search continues, and so does one with a larger budget or with more families.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.behaviour_archive import BATCH, FamilySearch, SearchSeed
from mdrive_sumo.generate.hard.candidate_evaluation import (
    KNOWN_SUITES,
    MOST_UNAIDED,
    PROBE_MODE,
    PROBED_AGENTS,
    UNAIDED_AGENTS,
    CandidateEvaluation,
    CandidateTask,
    evaluate_candidate,
    make_failed_evaluation,
)
from mdrive_sumo.generate.hard.elite_check import EliteCheck
from mdrive_sumo.generate.hard.family import ScenarioFamily
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.runs.journal import Fingerprint, Journal
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import describe_first_error

CANDIDATE_LIMIT_S = 1800.0
"""Wall clock for one candidate: it ends what hangs, and must not end what only waits for a busy machine."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """What the user chooses of a search."""

    families: tuple[ScenarioFamily, ...]
    budget: int
    """Candidates per family, rounded up to whole batches."""
    seed: SearchSeed
    workers: int
    known_suites: tuple[str, ...] = KNOWN_SUITES
    """Suites whose scenarios must not be repeated."""

    @property
    def batches(self) -> int:
        """Batches per family."""
        return -(-self.budget // BATCH)

    @property
    def fingerprint(self) -> Fingerprint:
        """What makes two searches the same: neither budget nor families, which only extend a search."""
        return {
            "search": "mdrive-sumo/hard-search/1",
            "generator": HARD_GENERATOR,
            "seed": self.seed.seed,
            "split": self.seed.split,
            "secret": self.seed.derive("fingerprint") if self.seed.secret else "",
            "known": ",".join(self.known_suites),
            "probe": f"{' '.join(PROBED_AGENTS)} {PROBE_MODE}",
            "unaided": f"{' '.join(UNAIDED_AGENTS)} {MOST_UNAIDED:g}",
        }


class SearchProgress(Protocol):
    """Receives the progress of a search."""

    def begin(self, total: int, kept: int) -> None:
        """The search begins: the number of candidates, and how many of them the journal has."""
        ...

    def evaluated(self, evaluation: CandidateEvaluation) -> None:
        """A candidate was evaluated."""
        ...

    def note(self, text: str) -> None:
        """A message for the user."""
        ...


class SearchJournal:
    """The journal of a search: evaluations and checks of elites, by the id of the candidate."""

    def __init__(self, journal: Journal) -> None:
        """Read what earlier starts wrote. Raises InputError for an entry that is none."""
        self._journal = journal
        self.path = journal.path
        self.evaluations: dict[str, CandidateEvaluation] = {}
        self.checks: dict[str, EliteCheck] = {}
        for entry in journal.results:
            try:
                self._keep(entry)
            except (ValidationError, TypeError, KeyError) as error:
                what = describe_first_error(error) if isinstance(error, ValidationError) else "expected an entry"
                raise InputError(f"{journal.path}: {entry['id']!r:.80}: {what}; --fresh starts anew") from None

    def add_evaluation(self, evaluation: CandidateEvaluation) -> None:
        """Append an evaluation; it is on the disk when this returns."""
        self.evaluations[evaluation.id] = evaluation
        self._journal.add_result({"id": evaluation.id, "evaluation": evaluation.model_dump(mode="json")})

    def add_check(self, check: EliteCheck) -> None:
        """Append the check of an elite."""
        self.checks[check.id] = check
        self._journal.add_result({"id": check.id, "check": check.model_dump(mode="json")})

    def _keep(self, entry: Mapping[str, Any]) -> None:
        if "check" in entry:
            check = EliteCheck.model_validate(entry["check"])
            self.checks[check.id] = check
        else:
            evaluation = CandidateEvaluation.model_validate(entry["evaluation"])
            self.evaluations[evaluation.id] = evaluation


def run_search(
    settings: SearchSettings, journal: SearchJournal, progress: SearchProgress, *, only_kept: bool = False
) -> tuple[FamilySearch, ...]:
    """Search all families and return them with their archives. Raises InputError, KeyboardInterrupt.

    only_kept: evaluate nothing; a family ends with the first batch that the journal does not hold completely.
    """
    searches = tuple(FamilySearch(family, settings.seed) for family in settings.families)
    active = list(searches)
    progress.begin(len(active) * settings.batches * BATCH, len(journal.evaluations))
    with ProcessPool[CandidateTask, CandidateEvaluation](
        evaluate_candidate, settings.workers, CANDIDATE_LIMIT_S
    ) as pool:
        for _ in range(settings.batches):
            batches = [
                [CandidateTask(search.family, one, settings.known_suites) for one in search.propose_batch()]
                for search in active
            ]
            missing = [_find_missing(batch, journal) for batch in batches]
            if not only_kept:
                _evaluate(pool, _interleave(missing), journal, progress)
            for search, batch in zip(active, batches, strict=True):
                names = [task.candidate.scenario_id for task in batch]
                search.record_batch([journal.evaluations[name] for name in names if name in journal.evaluations])
            if only_kept:
                active = [search for search, tasks in zip(active, missing, strict=True) if not tasks]
    return searches


def _find_missing(batch: Sequence[CandidateTask], journal: SearchJournal) -> list[CandidateTask]:
    """Return the candidates that the journal does not hold. Raises InputError where it has one with other values."""
    for task in batch:
        found = journal.evaluations.get(task.candidate.scenario_id)
        if found is not None and (found.values, found.seed) != (task.candidate.values, task.candidate.seed):
            raise InputError(
                f"{journal.path}: candidate {found.id}: expected values {task.candidate.values}, found {found.values};"
                " its family or the search has changed since; --fresh starts anew"
            )
    return [task for task in batch if task.candidate.scenario_id not in journal.evaluations]


def _interleave(batches: Sequence[Sequence[CandidateTask]]) -> Iterator[CandidateTask]:
    """Yield the tasks of all families in turn, so that an interrupted search has about the same number of each."""
    for rank in range(max((len(batch) for batch in batches), default=0)):
        yield from (batch[rank] for batch in batches if rank < len(batch))


def _evaluate(
    pool: ProcessPool[CandidateTask, CandidateEvaluation],
    tasks: Iterator[CandidateTask],
    journal: SearchJournal,
    progress: SearchProgress,
) -> None:
    for task, outcome in pool.run(tasks):
        evaluation = make_failed_evaluation(task, outcome.reason) if isinstance(outcome, WorkerFailure) else outcome
        journal.add_evaluation(evaluation)
        progress.evaluated(evaluation)
