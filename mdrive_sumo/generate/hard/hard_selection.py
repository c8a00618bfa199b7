"""Choose the scenarios of a suite from all candidates that passed the search, and check those that were chosen.

The choice meets the aims of the tier (`suite_aims`), and among all choices that do it is the one in which waiting by
one's number scores least. No two of its scenarios are duplicates. The aims speak of means over the suite, so the choice
is a program over all candidates (`selection_program`); taken one by one, the last ones would have to repair what the
first ones did.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.generate.duplicates import find_rivals
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.elite_check import CHECK_SEEDS, EliteCheck, EliteTask, check_elite, describe_check
from mdrive_sumo.generate.hard.hard_recipe import build_hard_scenario
from mdrive_sumo.generate.hard.selection_program import SelectionProblem, find_cliques, solve_selection
from mdrive_sumo.generate.hard.suite_aims import (
    LEAST_CATEGORIES,
    OF_EACH_CATEGORY,
    build_aims,
    find_most_of_category,
)
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import Scenario

CHECK_LIMIT_S = 900.0
"""Wall clock for the drives of one elite."""


@dataclass(frozen=True, slots=True)
class ChosenElite:
    """An elite with its scenario."""

    evaluation: CandidateEvaluation
    scenario: Scenario


@dataclass(frozen=True, slots=True)
class CandidatePool:
    """Candidates with their scenarios, and which of them are duplicates of each other."""

    candidates: Sequence[CandidateEvaluation]
    """In the order of their ids."""
    scenario_by_id: Mapping[str, Scenario]
    rivals: Mapping[str, frozenset[str]]
    """Ids of the duplicates of each candidate."""


def build_pool(candidates: Sequence[CandidateEvaluation]) -> CandidatePool:
    """Build the scenarios of candidates and compare them."""
    scenario_by_id = {one.id: build_hard_scenario(one.recipe) for one in candidates}
    ordered = sorted(candidates, key=lambda one: one.id)
    return CandidatePool(ordered, scenario_by_id, find_rivals(scenario_by_id.values()))


def select_elites(pool: CandidatePool, fit: Collection[str], count: int) -> tuple[ChosenElite, ...]:
    """Return up to `count` candidates with their scenarios; no two of them are duplicates. fit: ids to choose from."""
    candidates = [one for one in pool.candidates if one.id in fit]
    if not candidates:
        return ()
    chosen = [candidates[i] for i in solve_selection(build_problem(candidates, pool.rivals, count))]
    return tuple(ChosenElite(one, pool.scenario_by_id[one.id]) for one in chosen)


def build_problem(
    candidates: Sequence[CandidateEvaluation], rivals: Mapping[str, frozenset[str]], count: int
) -> SelectionProblem:
    """Return the program that chooses `count` of the candidates."""
    aims = build_aims(count)
    index = {one.id: i for i, one in enumerate(candidates)}
    families = sorted({one.family for one in candidates})
    return SelectionProblem(
        count=count,
        costs=np.array([one.measured.waiting_score for one in candidates]),
        excess=np.array([[aim.compute_excess(one) for one in candidates] for aim in aims]),
        prices=np.array([aim.price for aim in aims]),
        groups=[[i for i, one in enumerate(candidates) if one.family == family] for family in families],
        least_groups=LEAST_CATEGORIES,
        of_each_group=OF_EACH_CATEGORY,
        most_of_group=find_most_of_category(count),
        cliques=find_cliques(
            [frozenset(index[name] for name in rivals[one.id] if name in index) for one in candidates]
        ),
    )


@dataclass(frozen=True, slots=True)
class SelectionSettings:
    """What the user chooses of a selection."""

    count: int
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
            chosen = select_elites(pool, fit, settings.count)
            tasks = [EliteTask(one.scenario, CHECK_SEEDS) for one in chosen if one.evaluation.id not in journal.checks]
            if not tasks:
                return chosen
            note(f"{len(tasks)} of {len(chosen)} chosen scenarios to drive with omniscient and {CHECK_SEEDS} seeds")
            for done, (task, outcome) in enumerate(workers.run(tasks), start=1):
                failed = isinstance(outcome, WorkerFailure)
                check = EliteCheck(id=task.scenario.id, seeds=task.seeds, reason=outcome.reason) if failed else outcome
                journal.add_check(check)
                note(f"{done}/{len(tasks)}  {check.id}: {describe_check(check)}")
