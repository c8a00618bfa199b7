"""Choose the scenarios of a suite from all candidates that passed the search, and check those that were chosen.

One scenario after the other is chosen: first `OF_EACH_FAMILY` of each family that has any. Then, until the shares are
reached, one on a dense corridor and one whose certificate of need holds come first. Among what is left the candidate is
chosen that brings the mean score of the best rules to the mean that is aimed at, and where agents without messages lose
most: the objective of the search is the gap, but a suite of which every scenario is lost separates no two agents.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from mdrive_sumo.generate.duplicates import find_duplicate
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


@dataclass(frozen=True, slots=True)
class ChosenElite:
    """An elite with its scenario."""

    evaluation: CandidateEvaluation
    scenario: Scenario


@dataclass
class EliteSelection:
    """The scenarios chosen so far, and the elites that are left by family."""

    left: Mapping[str, list[CandidateEvaluation]]
    mean_score: float
    """Mean score of the best rules that the suite aims at."""
    scenario_by_id: dict[str, Scenario]
    """Scenarios that were built already; grows."""
    chosen: list[ChosenElite] = field(default_factory=list[ChosenElite])

    def choose_next(self) -> bool:
        """Choose one more scenario; return False if no elite is left."""
        while (elite := self._find_best()) is not None:
            self.left[elite.family].remove(elite)
            scenario = self._build(elite)
            here = (one.scenario for one in self.chosen if one.scenario.network == scenario.network)
            if find_duplicate(scenario, here) is None:
                self.chosen.append(ChosenElite(elite, scenario))
                return True
        return False

    def _find_best(self) -> CandidateEvaluation | None:
        left = self._list_left()
        for is_wanted, share in WANTED.items():
            if sum(is_wanted(one.evaluation) for one in self.chosen) < share * (len(self.chosen) + 1):
                left = [elite for elite in left if is_wanted(elite)] or left
        if not left:
            return None
        wanted = self._compute_wanted_score()
        return min(left, key=lambda elite: (_compute_distance(elite, wanted), elite.id))

    def _list_left(self) -> list[CandidateEvaluation]:
        """Return what may be chosen next: from the families that still have too few, else from all."""
        few = {family: elites for family, elites in self.left.items() if self._count(family) < OF_EACH_FAMILY}
        return [one for elites in few.values() for one in elites] or [
            one for elites in self.left.values() for one in elites
        ]

    def _count(self, family: str) -> int:
        return sum(one.evaluation.family == family for one in self.chosen)

    def _compute_wanted_score(self) -> float:
        """Return the score with which the mean would be the one that is aimed at."""
        total = sum(one.evaluation.measured.score for one in self.chosen)
        return self.mean_score * (len(self.chosen) + 1) - total

    def _build(self, elite: CandidateEvaluation) -> Scenario:
        if elite.id not in self.scenario_by_id:
            self.scenario_by_id[elite.id] = build_hard_scenario(elite.recipe)
        return self.scenario_by_id[elite.id]


def _compute_distance(elite: CandidateEvaluation, wanted: float) -> float:
    """Return how far the scores of an elite are from those wanted: of the best rules, and 0 without messages."""
    return abs(elite.measured.score - wanted) + UNAIDED_WEIGHT * elite.measured.unaided_score


def select_elites(
    elites: Sequence[CandidateEvaluation], count: int, mean_score: float, scenario_by_id: dict[str, Scenario]
) -> tuple[ChosenElite, ...]:
    """Return up to `count` elites with their scenarios; no two of them are duplicates.

    scenario_by_id: scenarios that were built already; those that are built now are added.
    """
    left: dict[str, list[CandidateEvaluation]] = {}
    for elite in elites:
        left.setdefault(elite.family, []).append(elite)
    selection = EliteSelection(left, mean_score, scenario_by_id)
    while len(selection.chosen) < count and selection.choose_next():
        pass
    return tuple(selection.chosen)


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
    scenario_by_id: dict[str, Scenario] = {}
    with ProcessPool[EliteTask, EliteCheck](check_elite, settings.workers, CHECK_LIMIT_S) as pool:
        while True:
            fit = [one for one in elites if one.id not in journal.checks or journal.checks[one.id].is_solved]
            chosen = select_elites(fit, settings.count, settings.mean_score, scenario_by_id)
            tasks = [EliteTask(one.scenario, CHECK_SEEDS) for one in chosen if one.evaluation.id not in journal.checks]
            if not tasks:
                return chosen
            note(f"{len(tasks)} of {len(chosen)} chosen scenarios to drive with omniscient and {CHECK_SEEDS} seeds")
            for done, (task, outcome) in enumerate(pool.run(tasks), start=1):
                failed = isinstance(outcome, WorkerFailure)
                check = EliteCheck(id=task.scenario.id, seeds=task.seeds, reason=outcome.reason) if failed else outcome
                journal.add_check(check)
                note(f"{done}/{len(tasks)}  {check.id}: {describe_check(check)}")
