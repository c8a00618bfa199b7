"""Choose the scenarios of a suite from all candidates that passed the search, and check those that were chosen.

One scenario after the other is chosen: first `OF_EACH_FAMILY` of each family that has any. Then, until the shares are
reached, one on a dense corridor and one whose certificate of need holds come first. Among what is left the candidate is
chosen that brings the mean score of the best rules to the mean that is aimed at, where agents without messages lose
most, and that has few duplicates among the others: the objective of the search is the gap, but a suite of which every
scenario is lost separates no two agents.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from mdrive_sumo.generate.duplicates import find_rivals
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.corridors import is_corridor_network
from mdrive_sumo.generate.hard.elite_check import CHECK_SEEDS, EliteCheck, EliteTask, check_elite, describe_check
from mdrive_sumo.generate.hard.hard_recipe import build_hard_scenario
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import Scenario

CHECK_LIMIT_S = 900.0
"""Wall clock for the drives of one elite."""


def is_on_corridor(elite: CandidateEvaluation) -> bool:
    """Return whether an elite drives on a dense corridor."""
    return is_corridor_network(elite.measured.network)


def is_certified(elite: CandidateEvaluation) -> bool:
    """Return whether the certificate of need of an elite holds."""
    return elite.measured.is_certified


WANTED: Mapping[Callable[[CandidateEvaluation], bool], float] = {is_on_corridor: 1 / 3, is_certified: 2 / 3}
"""Least shares of a suite (issue K)."""
OF_EACH_FAMILY = 2
"""So many scenarios of each family come first, where it has them; then the best of all families."""
UNAIDED_WEIGHT = 1.0
"""What a point of the agents without messages counts against one between the best rules and the score aimed at."""
RIVAL_WEIGHT = 10.0
"""What each candidate counts that a choice excludes as its duplicate."""


@dataclass(frozen=True, slots=True)
class ChosenElite:
    """An elite with its scenario."""

    evaluation: CandidateEvaluation
    scenario: Scenario


@dataclass(frozen=True, slots=True)
class CandidatePool:
    """Candidates with their scenarios, and which of them are duplicates of each other."""

    candidates: Sequence[CandidateEvaluation]
    scenario_by_id: Mapping[str, Scenario]
    rivals: Mapping[str, frozenset[str]]
    """Ids of the duplicates of each candidate."""


def build_pool(candidates: Sequence[CandidateEvaluation]) -> CandidatePool:
    """Build the scenarios of candidates and compare them."""
    scenario_by_id = {one.id: build_hard_scenario(one.recipe) for one in candidates}
    return CandidatePool(candidates, scenario_by_id, find_rivals(scenario_by_id.values()))


@dataclass
class EliteSelection:
    """The scenarios chosen so far, and the candidates that are left."""

    pool: CandidatePool
    mean_score: float
    """Mean score of the best rules that the suite aims at."""
    left: dict[str, CandidateEvaluation]
    """By id; none is a duplicate of a chosen one."""
    chosen: list[CandidateEvaluation] = field(default_factory=list[CandidateEvaluation])

    def choose_next(self) -> None:
        """Choose one more of the candidates that are left."""
        wanted = self._compute_wanted_score()
        best = min(self._list_first(), key=lambda one: (self._compute_cost(one, wanted), one.id))
        self.chosen.append(best)
        for name in {best.id, *self.pool.rivals[best.id]}:
            self.left.pop(name, None)

    def _list_first(self) -> Sequence[CandidateEvaluation]:
        """Return the candidates that come first, as the module says."""
        turns = Counter(one.family for one in self.chosen)
        everything = list(self.left.values())
        left = [one for one in everything if turns[one.family] < OF_EACH_FAMILY] or everything
        for is_wanted, share in WANTED.items():
            if sum(map(is_wanted, self.chosen)) < share * (len(self.chosen) + 1):
                left = [one for one in left if is_wanted(one)] or left
        return left

    def _compute_wanted_score(self) -> float:
        """Return the score with which the mean would be the one that is aimed at."""
        total = sum(one.measured.score for one in self.chosen)
        return self.mean_score * (len(self.chosen) + 1) - total

    def _compute_cost(self, one: CandidateEvaluation, wanted: float) -> float:
        """Return how far the scores are from those wanted, and how many other candidates this one excludes."""
        rivals = sum(name in self.left for name in self.pool.rivals[one.id])
        unaided = UNAIDED_WEIGHT * one.measured.unaided_score
        return abs(one.measured.score - wanted) + unaided + RIVAL_WEIGHT * rivals


def select_elites(pool: CandidatePool, fit: Collection[str], count: int, mean_score: float) -> tuple[ChosenElite, ...]:
    """Return up to `count` candidates with their scenarios; no two of them are duplicates. fit: ids to choose from."""
    selection = EliteSelection(pool, mean_score, {one.id: one for one in pool.candidates if one.id in fit})
    while len(selection.chosen) < count and selection.left:
        selection.choose_next()
    return tuple(ChosenElite(one, pool.scenario_by_id[one.id]) for one in selection.chosen)


@dataclass(frozen=True, slots=True)
class SelectionSettings:
    """What the user chooses of a selection."""

    count: int
    mean_score: float
    workers: int


def select_checked_elites(
    elites: Sequence[CandidateEvaluation],
    settings: SelectionSettings,
    journal: SearchJournal,
    note: Callable[[str], None],
) -> tuple[ChosenElite, ...]:
    """Return elites that `omniscient` solves with every seed. Checks are kept in the journal.

    Elites that fail the check are left out and the choice is made again, until all of the chosen ones have passed.
    """
    unsolved = {check.id for check in journal.checks.values() if not check.is_solved}
    pool = build_pool([one for one in elites if one.id not in unsolved])
    with ProcessPool[EliteTask, EliteCheck](check_elite, settings.workers, CHECK_LIMIT_S) as workers:
        while True:
            fit = {one.id for one in elites if one.id not in journal.checks or journal.checks[one.id].is_solved}
            chosen = select_elites(pool, fit, settings.count, settings.mean_score)
            tasks = [EliteTask(one.scenario, CHECK_SEEDS) for one in chosen if one.evaluation.id not in journal.checks]
            if not tasks:
                return chosen
            note(f"{len(tasks)} of {len(chosen)} chosen scenarios to drive with omniscient and {CHECK_SEEDS} seeds")
            for done, (task, outcome) in enumerate(workers.run(tasks), start=1):
                failed = isinstance(outcome, WorkerFailure)
                check = EliteCheck(id=task.scenario.id, seeds=task.seeds, reason=outcome.reason) if failed else outcome
                journal.add_check(check)
                note(f"{done}/{len(tasks)}  {check.id}: {describe_check(check)}")
