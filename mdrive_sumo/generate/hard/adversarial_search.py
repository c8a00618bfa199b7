"""The adversarial search over families: batch after batch of each family, evaluated in worker processes.

A journal keeps every evaluated candidate (format, checksums and lock: `runs.journal`). A search that is started again
proposes the same candidates in the same order and takes from the journal what was evaluated before. So an interrupted
search continues, and so does one with a larger budget or with more families.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.behaviour_archive import BATCH, FamilySearch, SearchSeed
from mdrive_sumo.generate.hard.candidate_evaluation import (
    KNOWN_SUITES,
    MOST_BLIND,
    CandidateEvaluation,
    CandidateTask,
    evaluate_candidate,
    make_failed_evaluation,
)
from mdrive_sumo.generate.hard.candidate_probes import describe_probes
from mdrive_sumo.generate.hard.elite_check import EliteCheck
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.runs.executor import Key
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
    """New candidates per family, rounded up to whole batches."""
    seed: SearchSeed
    workers: int
    known_suites: tuple[str, ...] = KNOWN_SUITES
    """Suites whose scenarios must not be repeated."""
    start: Mapping[str, tuple[FamilyCandidate, ...]] = field(default_factory=dict[str, tuple[FamilyCandidate, ...]])
    """Candidates of an earlier suite, by family, that come before all others and do not count against the budget."""

    @property
    def batches(self) -> int:
        """Batches of new candidates per family."""
        return -(-self.budget // BATCH)

    @property
    def fingerprint(self) -> Fingerprint:
        """What makes two searches the same: neither budget nor families, which only extend a search."""
        return {
            "search": "mdrive-sumo/hard-search/2",
            "generator": HARD_GENERATOR,
            "seed": self.seed.seed,
            "split": self.seed.split,
            "secret": self.seed.derive("fingerprint") if self.seed.secret else "",
            "known": ",".join(self.known_suites),
            "start": self.seed.start,
            "probes": f"<{MOST_BLIND:g} {describe_probes()}",
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


@dataclass
class _FamilyQueue:
    """The current batch of a family: its tasks, and those that still have to be evaluated."""

    search: FamilySearch
    settings: SearchSettings
    journal: SearchJournal
    batches: int = 0
    """Recorded batches."""
    batch: Sequence[CandidateTask] = ()
    waiting: list[CandidateTask] = field(default_factory=list[CandidateTask])
    """Those that no worker process has yet."""

    @property
    def all_batches(self) -> int:
        """Batches to record, with that of the start."""
        return self.settings.batches + self.search.has_start

    @property
    def given(self) -> int:
        """New candidates that worker processes have had, below 0 while those of the start wait."""
        return (self.batches + 1 - self.search.has_start) * BATCH - len(self.waiting)

    def advance(self) -> None:
        """Record complete batches and propose the next one, until one is incomplete or none is left."""
        while self.batches < self.all_batches:
            if not self.batch:
                known = self.settings.known_suites
                self.batch = [CandidateTask(self.search.family, one, known) for one in self.search.propose_batch()]
                self.waiting = _find_missing(self.batch, self.journal)
            names = [task.candidate.scenario_id for task in self.batch]
            if not all(name in self.journal.evaluations for name in names):
                return
            self._record(names)
            self.batches += 1

    def end(self) -> None:
        """Record what there is of the current batch."""
        names = [task.candidate.scenario_id for task in self.batch]
        self._record([name for name in names if name in self.journal.evaluations])

    def _record(self, names: Sequence[str]) -> None:
        self.search.record_batch([self.journal.evaluations[name] for name in names])
        self.batch, self.waiting = (), []


def run_search(
    settings: SearchSettings, journal: SearchJournal, progress: SearchProgress, *, only_kept: bool = False
) -> tuple[FamilySearch, ...]:
    """Search all families and return them with their archives. Raises InputError, KeyboardInterrupt.

    A family waits for its own batch alone, so that no worker process idles while another family's batch ends.
    only_kept: evaluate nothing; a family ends with the first batch that the journal does not hold completely.
    """
    starts = {family.category: settings.start.get(family.category, ()) for family in settings.families}
    searches = [FamilySearch(family, settings.seed, starts[family.category]) for family in settings.families]
    queues = [_FamilyQueue(search, settings, journal) for search in searches]
    total = len(queues) * settings.batches * BATCH + sum(map(len, starts.values()))
    progress.begin(total, len(journal.evaluations))
    for queue in queues:
        queue.advance()
    if not only_kept:
        with ProcessPool[CandidateTask, CandidateEvaluation](
            evaluate_candidate, settings.workers, CANDIDATE_LIMIT_S
        ) as pool:
            _evaluate(pool, queues, journal, progress)
    for queue in queues:
        queue.end()
    return tuple(queue.search for queue in queues)


def _evaluate(
    pool: ProcessPool[CandidateTask, CandidateEvaluation],
    queues: Sequence[_FamilyQueue],
    journal: SearchJournal,
    progress: SearchProgress,
) -> None:
    """Evaluate the batches of all families; the family that is furthest behind comes first."""
    running: dict[Key, tuple[_FamilyQueue, CandidateTask]] = {}
    while True:
        while pool.free_slots and (ready := [queue for queue in queues if queue.waiting]):
            queue = min(ready, key=lambda one: one.given)
            task = queue.waiting.pop(0)
            key = task.candidate.scenario_id
            running[key] = queue, task
            pool.submit(key, task)
        if not running:
            return
        for key, outcome in pool.collect_outcomes():
            queue, task = running.pop(key)
            failed = isinstance(outcome, WorkerFailure)
            evaluation = make_failed_evaluation(task, outcome.reason) if failed else outcome
            journal.add_evaluation(evaluation)
            progress.evaluated(evaluation)
            queue.advance()


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
