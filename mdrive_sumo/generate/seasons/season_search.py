"""Search of a season's pools in worker processes: rounds of candidates until every group has its pool.

A pool is the first so many accepted candidates by number, whatever else was evaluated: it depends neither on the number
of workers nor on interruptions.
"""

import random
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Final, Protocol

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.seasons.season_candidate import (
    SeasonOutcome,
    SeasonTask,
    evaluate_candidate,
    read_outcome,
)
from mdrive_sumo.generate.seasons.season_plan import SeasonGroup, Selection
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.generate.selection import SelectionItem, select_items
from mdrive_sumo.runs.journal import Journal
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure

LIMIT_S: Final = 300.0
"""[s] Wall clock for one candidate, a hundred times what most take; one that takes longer counts as rejected."""
MAX_TRIES: Final = 100
"""Candidates per scenario of a pool before a group is given up: in the rarest groups one in 15 is accepted (season
4: cut-ins at signals, whose routes often end before the lights)."""
LEAST_RATE: Final = 0.05
"""Share of accepted candidates that is expected at least, for the size of a round: about that of the rarest groups."""
SURPLUS: Final = 1.15
"""Candidates of a round per candidate that is expected to be needed: few pools then need a third round."""


class SeasonProgress(Protocol):
    """Shows how a search goes."""

    def note(self, text: str) -> None:
        """Show a line."""
        ...


class SeasonSearch:
    """Candidates of a season's groups, evaluated and noted in a journal."""

    def __init__(self, seed: SeasonSeed, work: Path, journal: Journal, progress: SeasonProgress) -> None:
        self._seed, self._work, self._journal, self._progress = seed, work, journal, progress
        kept = (read_outcome(line) for line in journal.results)
        self._outcomes: dict[str, SeasonOutcome] = {outcome.key: outcome for outcome in kept}

    def run(self, groups: Sequence[SeasonGroup], workers: int) -> None:
        """Evaluate candidates until every group has its pool. Raises InputError if one cannot be filled."""
        if self._outcomes:
            self._progress.note(f"continuing: the journal holds {len(self._outcomes)} candidates")
        with ProcessPool(evaluate_candidate, workers, LIMIT_S) as pool:
            while tasks := [task for group in groups for task in self._list_next(group)]:
                for n, (task, found) in enumerate(pool.run(_interleave(tasks)), 1):
                    outcome = _read_result(task, found)
                    self._outcomes[outcome.key] = outcome
                    self._journal.add_result(outcome.to_line())
                    result = f"rejected at {outcome.stage}" if outcome.item is None else outcome.item.network
                    self._progress.note(f"{n}/{len(tasks)}  {outcome.key}: {result}")

    def list_pool(self, group: SeasonGroup) -> list[SelectionItem]:
        """Return the pool of a group."""
        found = (outcome.item for outcome in self._list_evaluated(group) if outcome.item is not None)
        return list(islice(found, group.pool_size))

    def count_rejections(self, group: SeasonGroup) -> Counter[str]:
        """Return how many candidates of a group each stage rejected."""
        return Counter(outcome.stage for outcome in self._list_evaluated(group) if outcome.item is None)

    def _list_evaluated(self, group: SeasonGroup) -> list[SeasonOutcome]:
        """Return the outcomes of a group from number 0 to the first that is missing."""
        found: list[SeasonOutcome] = []
        while (outcome := self._outcomes.get(self._build_task(group, len(found)).key)) is not None:
            found.append(outcome)
        return found

    def _list_next(self, group: SeasonGroup) -> list[SeasonTask]:
        done = self._list_evaluated(group)
        missing = group.pool_size - sum(outcome.item is not None for outcome in done)
        if missing <= 0:
            return []
        if len(done) >= MAX_TRIES * group.pool_size:
            stages = ", ".join(f"{count} at {stage}" for stage, count in self.count_rejections(group).most_common())
            raise InputError(
                f"{group.name}: expected {group.pool_size} scenarios among {len(done)} candidates,"
                f" found {group.pool_size - missing} (rejected: {stages})"
            )
        rate = max((group.pool_size - missing + 1) / (len(done) + 1), LEAST_RATE)  # of one more that is accepted
        wanted = range(len(done), len(done) + int(missing / rate * SURPLUS) + 2)
        tasks = (self._build_task(group, number) for number in wanted)
        return [task for task in tasks if task.key not in self._outcomes]

    def _build_task(self, group: SeasonGroup, number: int) -> SeasonTask:
        return SeasonTask(self._seed, group, number, self._work)


def select_season(search: SeasonSearch, selection: Selection, seed: SeasonSeed) -> tuple[SelectionItem, ...]:
    """Return the scenarios of a selection, chosen from the pools of its groups."""
    pool = [item for group in selection.groups for item in search.list_pool(group)]
    wanted = {group.name: group.count for group in selection.groups}
    rng = random.Random(seed.derive("selection", selection.name))
    return select_items(pool, wanted, selection.means, rng, selection.least_hidden)


def _read_result(task: SeasonTask, found: SeasonOutcome | WorkerFailure) -> SeasonOutcome:
    if isinstance(found, SeasonOutcome):
        return found
    if found.kind is FailureKind.INPUT:
        raise InputError(found.reason)
    return SeasonOutcome(task.key, None, "failure", found.reason[:300])


def _interleave(tasks: Iterable[SeasonTask]) -> list[SeasonTask]:
    """Return the tasks by number, so that all groups go on together."""
    return sorted(tasks, key=lambda task: (task.number, task.key))
