"""Choose the scenarios of a suite from all candidates that passed the search.

The choice meets the aims of the tier (`suite_aims`), and among all choices that do it is the one in which the speeding
and cautious drivers without messages score least on average. No two of its scenarios are duplicates. The aims speak
of means over the suite, so the choice is a program over all candidates (`generate.selection_program`); taken one by
one, the last ones would have to repair what the first ones did.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.generate.duplicates import find_rivals
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.hard_places import HardPlace
from mdrive_sumo.generate.hard.hard_recipe import HardRecipe, build_hard_scenario
from mdrive_sumo.generate.hard.suite_aims import build_aims, find_most_of_category, is_proven
from mdrive_sumo.generate.hard.suite_requirements import (
    LEAST_CATEGORIES,
    LEAST_PLACES,
    MOST_OF_PLACE,
    OF_EACH_CATEGORY,
    PROVEN_PLACES,
)
from mdrive_sumo.generate.selection_program import (
    Grouping,
    SelectionProblem,
    find_cliques,
    group_items,
    solve_selection,
)
from mdrive_sumo.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True)
class ChosenCandidate:
    """A candidate with its recipe, its scenario and its place."""

    evaluation: CandidateEvaluation
    recipe: HardRecipe
    scenario: Scenario
    place: HardPlace


def choose_scenarios(
    candidates: Sequence[CandidateEvaluation], places: Mapping[str, HardPlace], count: int
) -> tuple[ChosenCandidate, ...]:
    """Return up to `count` candidates with their scenarios; no two of them are duplicates. places: by name."""
    if not candidates:
        return ()
    ordered = sorted(candidates, key=lambda one: one.id)
    built = [_build(one, places[one.place]) for one in ordered]
    rivals = find_rivals(one.scenario for one in built)
    return tuple(built[i] for i in solve_selection(build_problem(ordered, rivals, count)))


def _build(evaluation: CandidateEvaluation, place: HardPlace) -> ChosenCandidate:
    recipe = evaluation.make_recipe(place)
    return ChosenCandidate(evaluation, recipe, build_hard_scenario(recipe, place.load_roads()), place)


def build_problem(
    candidates: Sequence[CandidateEvaluation], rivals: Mapping[str, frozenset[str]], count: int
) -> SelectionProblem:
    """Return the program that chooses `count` of the candidates."""
    aims = build_aims(count)
    index = {one.id: i for i, one in enumerate(candidates)}
    return SelectionProblem(
        count=count,
        costs=np.array([one.measured.variants_score for one in candidates]),
        excess=np.array([[aim.compute_excess(one) for one in candidates] for aim in aims]),
        prices=np.array([aim.price for aim in aims]),
        groupings=(
            Grouping(
                group_items([one.family for one in candidates]),
                LEAST_CATEGORIES,
                OF_EACH_CATEGORY,
                find_most_of_category(count),
            ),
            Grouping(group_items([one.place for one in candidates]), LEAST_PLACES, most_of_group=MOST_OF_PLACE),
            Grouping(group_items([one.place if is_proven(one) else None for one in candidates]), PROVEN_PLACES),
        ),
        cliques=find_cliques(
            [frozenset(index[name] for name in rivals[one.id] if name in index) for one in candidates]
        ),
    )
