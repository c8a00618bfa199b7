"""The choice under bounds on means: compared with all subsets of small sets."""

import random
from itertools import combinations

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate import selection_program
from mdrive_sumo.generate.selection_program import (
    Grouping,
    SelectionProblem,
    find_cliques,
    group_items,
    solve_selection,
)

GROUP_PRICE = 100.0


def draw_problem(seed: int, items: int = 9, count: int = 4) -> tuple[SelectionProblem, list[frozenset[int]]]:
    """Random costs, two aims, three groups, and conflicts between a fifth of all pairs."""
    rng = random.Random(seed)
    pairs = [pair for pair in combinations(range(items), 2) if rng.random() < 0.2]
    rivals = [frozenset(a + b - i for a, b in pairs if i in (a, b)) for i in range(items)]
    kinds = [rng.randrange(3) for _ in range(items)]
    places = [rng.choice((None, 0, 1, 2, 3)) for _ in range(items)]
    problem = SelectionProblem(
        count=count,
        costs=np.array([rng.uniform(0, 60) for _ in range(items)]),
        excess=np.array([[rng.uniform(-20, 20) for _ in range(items)] for _ in range(2)]),
        prices=np.array([10.0, 3.0]),
        groupings=(Grouping(group_items(kinds), 2, 2, 3), Grouping(group_items(places), 3, most_of_group=1)),
        cliques=find_cliques(rivals),
    )
    return problem, rivals


def price(problem: SelectionProblem, chosen: tuple[int, ...]) -> float:
    """What a choice costs, by the definitions in `SelectionProblem`."""
    n = problem.count
    total = sum(problem.costs[i] for i in chosen) / n
    for row, each in zip(problem.excess, problem.prices, strict=True):
        total += each * max(sum(row[i] for i in chosen) / n, 0.0)
    for grouping in problem.groupings:
        sizes = [len(set(group) & set(chosen)) for group in grouping.groups]
        enough = sum(size >= grouping.of_each_group for size in sizes)
        total += GROUP_PRICE * max(grouping.least_groups - enough, 0)
        total += GROUP_PRICE / n * sum(max(size - grouping.most_of_group, 0) for size in sizes)
    return total


def find_best(problem: SelectionProblem, rivals: list[frozenset[int]]) -> tuple[int, float]:
    """The largest size that conflicts allow, up to `count`, and the least price among all subsets of it."""
    for size in range(problem.count, 0, -1):
        free = [
            subset
            for subset in combinations(range(len(rivals)), size)
            if not any(b in rivals[a] for a, b in combinations(subset, 2))
        ]
        if free:
            return size, min(price(problem, subset) for subset in free)
    return 0, 0.0


@pytest.mark.parametrize("seed", range(25))
def test_no_subset_is_better(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selection_program, "RELATIVE_GAP", 0.0)
    problem, rivals = draw_problem(seed)
    chosen = solve_selection(problem)
    assert not any(b in rivals[a] for a, b in combinations(chosen, 2))
    assert (len(chosen), price(problem, chosen)) == pytest.approx(find_best(problem, rivals), abs=1e-6)


def test_a_choice_is_within_the_gap_of_the_best_and_the_same_each_time() -> None:
    for seed in range(100, 110):
        problem, rivals = draw_problem(seed, items=12, count=5)
        chosen = solve_selection(problem)
        _, best = find_best(problem, rivals)
        assert best - 1e-6 <= price(problem, chosen) <= best * (1 + 2 * selection_program.RELATIVE_GAP) + 1e-6
        assert solve_selection(problem) == chosen


def test_conflicts_come_before_the_number_of_items() -> None:
    everyone = [frozenset(range(9)) - {i} for i in range(9)]
    problem, _ = draw_problem(3)
    alone = SelectionProblem(**{**_fields(problem), "cliques": find_cliques(everyone)})
    assert find_cliques(everyone) == (tuple(range(9)),)
    assert len(solve_selection(alone)) == 1


def _fields(problem: SelectionProblem) -> dict[str, object]:
    return {name: getattr(problem, name) for name in SelectionProblem.__slots__}


@pytest.mark.parametrize("seed", range(10))
def test_cliques_cover_every_pair_and_nothing_else(seed: int) -> None:
    rng = random.Random(seed)
    pairs = {pair for pair in combinations(range(14), 2) if rng.random() < 0.5}
    rivals = [frozenset(a + b - i for a, b in pairs if i in (a, b)) for i in range(14)]
    cliques = find_cliques(rivals)
    assert {pair for clique in cliques for pair in combinations(clique, 2)} == pairs
    assert len(cliques) < len(pairs)


def test_without_a_solution_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Nothing:
        x, message = None, "Node limit reached."

    monkeypatch.setattr("scipy.optimize.milp", lambda *_, **__: Nothing)
    with pytest.raises(
        InputError, match="selection: expected a choice among 9 candidates, found none: Node limit reached"
    ):
        solve_selection(draw_problem(0)[0])
