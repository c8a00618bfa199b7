"""The adversarial search over families: candidates of all of them, evaluated in worker processes.

A journal keeps every evaluated candidate (format, checksums and lock: `runs.journal`). A search that is started again
proposes the same candidates in the same order and takes from the journal what was evaluated before. So an interrupted
search continues, and so does one with a larger budget or with more families.
"""

import math
from collections import Counter, deque
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
from mdrive_sumo.generate.hard.family_search import AHEAD, FamilySearch
from mdrive_sumo.generate.hard.hard_places import PLACES_OF_CHOICE, HardPlace, find_places
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.runs.executor import Key
from mdrive_sumo.runs.journal import Fingerprint, Journal
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import describe_first_error

CANDIDATE_LIMIT_S = 600.0
"""Wall clock for one candidate: it ends what hangs, and must not end what only waits for a busy machine."""
LEAST_COUNTED = 5
"""A family has turns as if so many had passed: a suite needs two of each category, and a choice among them."""


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """What the user chooses of a search."""

    families: tuple[ScenarioFamily, ...]
    budget: int
    """Candidates per family."""
    seed: SeasonSeed
    workers: int

    @property
    def fingerprint(self) -> Fingerprint:
        """What makes two searches the same: neither budget nor families, which only extend a search."""
        return {
            "search": "mdrive-sumo/hard-search/5",
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
    """The candidates of a family that are proposed and not yet recorded."""

    search: FamilySearch
    settings: SearchSettings
    journal: SearchJournal
    proposed: int = 0
    open: deque[CandidateTask] = field(default_factory=deque[CandidateTask])
    """Those that are not recorded, in their order."""
    waiting: deque[CandidateTask] = field(default_factory=deque[CandidateTask])
    """Those of them that no worker process has yet."""

    @property
    def turn(self) -> float:
        """What the next worker process goes by, the least first: candidates that were given, for those that passed.

        It changes no candidate, but a search that ends early has more of the families of which much passes, above all
        with certificates of level `all`, of which a suite needs many. The root, and the least number, keep the others
        from waiting for ever.
        """
        passed = max(self.search.passed + self.search.proven, LEAST_COUNTED)
        return (self.proposed - len(self.waiting)) / math.sqrt(passed)

    def advance(self) -> None:
        """Record what is evaluated, in the order of the proposals, and propose one more candidate for each."""
        while not self.search.is_over:
            while self.proposed < min(len(self.search.evaluations) + AHEAD, self.settings.budget):
                self._propose()
            if not self.open or self.open[0].candidate.scenario_id not in self.journal.evaluations:
                return
            self.search.record(self.journal.evaluations[self.open.popleft().candidate.scenario_id])
        self.open.clear()
        self.waiting.clear()

    def _propose(self) -> None:
        candidate = self.search.propose()
        task = CandidateTask(self.search.family, candidate, self.search.places[candidate.place])
        self.proposed += 1
        self.open.append(task)
        if not _is_kept(task, self.journal):
            self.waiting.append(task)

    def end(self) -> None:
        """Record what is evaluated behind candidates that are not."""
        for task in self.open:
            if (found := self.journal.evaluations.get(task.candidate.scenario_id)) is not None:
                self.search.record(found)


def run_search(
    settings: SearchSettings,
    pool: Sequence[HardPlace],
    journal: SearchJournal,
    progress: SearchProgress,
    *,
    only_kept: bool = False,
) -> tuple[FamilySearch, ...]:
    """Search all families on the places of a pool and return them. Raises InputError, KeyboardInterrupt.

    only_kept: evaluate nothing; a family ends with the last of its next `AHEAD` candidates that the journal holds.
    """
    searches = [FamilySearch(family, find_places(pool, family), settings.seed) for family in settings.families]
    queues = [_FamilyQueue(search, settings, journal) for search in searches]
    searched = {family.category for family in settings.families}
    kept = Counter(one.family for one in journal.evaluations.values() if one.family in searched)
    progress.begin(len(queues) * settings.budget, sum(min(n, settings.budget) for n in kept.values()))
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
    """Evaluate the candidates of all families; the family whose turn it is comes first."""
    running: dict[Key, tuple[_FamilyQueue, CandidateTask]] = {}
    while True:
        while pool.free_slots and (ready := [queue for queue in queues if queue.waiting]):
            queue = min(ready, key=lambda one: one.turn)
            task = queue.waiting.popleft()
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


def _is_kept(task: CandidateTask, journal: SearchJournal) -> bool:
    """Return whether the journal holds a candidate. Raises InputError where it has one with other values."""
    found = journal.evaluations.get(task.candidate.scenario_id)
    if found is not None and (found.place, found.values) != (task.candidate.place, task.candidate.values):
        raise InputError(
            f"{journal.path}: candidate {found.id}: expected values {task.candidate.values}, found {found.values};"
            " its family or the search has changed since; --fresh starts anew"
        )
    return found is not None
