"""The adversarial search over families: batch after batch of each family, evaluated in worker processes.

A journal keeps every evaluated candidate (format, checksums and lock: `runs.journal`). A search that is started again
proposes the same candidates in the same order and takes from the journal what was evaluated before. So an interrupted
search continues, and so does one with a larger budget or with more families.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.candidate_evaluation import (
    MOST_BLIND,
    CandidateEvaluation,
    CandidateTask,
    evaluate_candidate,
    make_failed_evaluation,
)
from mdrive_sumo.generate.hard.candidate_probes import describe_probes
from mdrive_sumo.generate.hard.family import ScenarioFamily
from mdrive_sumo.generate.hard.family_search import BATCH, FamilySearch
from mdrive_sumo.generate.hard.hard_places import PLACES_OF_CHOICE, HardPlace, find_places
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.runs.executor import Key
from mdrive_sumo.runs.journal import Fingerprint, Journal
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import describe_first_error

CANDIDATE_LIMIT_S = 600.0
"""Wall clock for one candidate: it ends what hangs, and must not end what only waits for a busy machine."""
MOST_COUNTED = 60
"""Candidates that passed from which on more give a family no more turns: a suite takes 30 of one."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """What the user chooses of a search."""

    families: tuple[ScenarioFamily, ...]
    budget: int
    """Candidates per family, rounded up to whole batches."""
    seed: SeasonSeed
    workers: int

    @property
    def batches(self) -> int:
        """Batches of candidates per family."""
        return -(-self.budget // BATCH)

    @property
    def fingerprint(self) -> Fingerprint:
        """What makes two searches the same: neither budget nor families, which only extend a search."""
        return {
            "search": "mdrive-sumo/hard-search/3",
            "generator": HARD_GENERATOR,
            **self.seed.describe(),
            "places": PLACES_OF_CHOICE,
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
    """The journal of a search: evaluations by the id of the candidate."""

    def __init__(self, journal: Journal) -> None:
        """Read what earlier starts wrote. Raises InputError for an entry that is none."""
        self._journal = journal
        self.path = journal.path
        self.evaluations: dict[str, CandidateEvaluation] = {}
        for entry in journal.results:
            try:
                self._keep(entry)
            except (ValidationError, TypeError, KeyError) as error:
                what = describe_first_error(error) if isinstance(error, ValidationError) else "expected an entry"
                raise InputError(f"{journal.path}: {entry['id']!r:.80}: {what}; --fresh starts anew") from None

    def add_evaluation(self, evaluation: CandidateEvaluation) -> None:
        """Append an evaluation; it is on the disk when this returns."""
        self.evaluations[evaluation.id] = evaluation
        self._journal.add_result(evaluation.model_dump(mode="json"))

    def _keep(self, entry: Mapping[str, Any]) -> None:
        evaluation = CandidateEvaluation.model_validate(entry)
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
    def turn(self) -> float:
        """What the next worker process goes by, the least first: candidates that were given, for those that passed.

        It changes no candidate, but a search that ends early has more of the families of which much passes; the root
        keeps the others from waiting for ever.
        """
        given = (self.batches + 1) * BATCH - len(self.waiting)
        return given / math.sqrt(1.0 + min(self.search.passed, MOST_COUNTED))

    def advance(self) -> None:
        """Record complete batches and propose the next one, until one is incomplete or none is left."""
        while self.batches < self.settings.batches and not self.search.is_hopeless:
            if not self.batch:
                family, places = self.search.family, self.search.places
                self.batch = [CandidateTask(family, one, places[one.place]) for one in self.search.propose_batch()]
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
    settings: SearchSettings,
    pool: Sequence[HardPlace],
    journal: SearchJournal,
    progress: SearchProgress,
    *,
    only_kept: bool = False,
) -> tuple[FamilySearch, ...]:
    """Search all families on the places of a pool and return them. Raises InputError, KeyboardInterrupt.

    A family waits for its own batch alone, so that no worker process idles while another family's batch ends.
    only_kept: evaluate nothing; a family ends with the first batch that the journal does not hold completely.
    """
    searches = [FamilySearch(family, find_places(pool, family), settings.seed) for family in settings.families]
    queues = [_FamilyQueue(search, settings, journal) for search in searches]
    progress.begin(len(queues) * settings.batches * BATCH, len(journal.evaluations))
    for queue in queues:
        queue.advance()
    if not only_kept:
        with ProcessPool[CandidateTask, CandidateEvaluation](
            evaluate_candidate, settings.workers, CANDIDATE_LIMIT_S
        ) as workers:
            _evaluate(workers, queues, journal, progress)
    for queue in queues:
        queue.end()
    return tuple(queue.search for queue in queues)


def _evaluate(
    pool: ProcessPool[CandidateTask, CandidateEvaluation],
    queues: Sequence[_FamilyQueue],
    journal: SearchJournal,
    progress: SearchProgress,
) -> None:
    """Evaluate the batches of all families; the family whose turn it is comes first."""
    running: dict[Key, tuple[_FamilyQueue, CandidateTask]] = {}
    while True:
        while pool.free_slots and (ready := [queue for queue in queues if queue.waiting]):
            queue = min(ready, key=lambda one: one.turn)
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
        if found is not None and (found.place, found.values) != (task.candidate.place, task.candidate.values):
            raise InputError(
                f"{journal.path}: candidate {found.id}: expected values {task.candidate.values}, found {found.values};"
                " its family or the search has changed since; --fresh starts anew"
            )
    return [task for task in batch if task.candidate.scenario_id not in journal.evaluations]
