"""Choose items under bounds on means, groups and conflicts: a mixed-integer linear program (HiGHS, by SciPy).

Only conflicts are absolute. Every other wish can be missed at a price, so the program always has a solution, and what
cannot be had is missed as little as possible. The search ends by its gap or number of nodes, never by time: the choice
does not depend on how fast or busy the machine is.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdrive_sumo.core.errors import InputError

RELATIVE_GAP = 0.005
"""Of the objective between the choice and the bound of the best one: 0.1 points of a mean of 20."""
NODE_LIMIT = 2000
"""Of the search tree."""
MISSING_GROUP_PRICE = 100.0
"""Of each group less than wanted, and of each item above `most_of_group`, divided by the number of items."""


@dataclass(frozen=True, slots=True)
class Grouping:
    """Items in groups, such as categories or places, and how many of each are wanted."""

    groups: Sequence[Sequence[int]]
    """Items of each group; an item is in one group at most."""
    least_groups: int
    """Groups wanted among the chosen; a group counts with `of_each_group` items."""
    of_each_group: int = 1
    most_of_group: float = math.inf
    """Most items of one group."""


def group_items(labels: Sequence[Hashable | None]) -> tuple[tuple[int, ...], ...]:
    """Return the items of each label, in the order in which labels first occur; those labelled None are in no group."""
    groups: dict[Hashable, list[int]] = {}
    for i, label in enumerate(labels):
        if label is not None:
            groups.setdefault(label, []).append(i)
    return tuple(map(tuple, groups.values()))


@dataclass(frozen=True, slots=True)
class SelectionProblem:
    """What to choose from. N is `count`."""

    count: int
    """Items to choose."""
    costs: NDArray[np.float64]
    """(I,) Cost of each item; their mean over the chosen is minimised."""
    excess: NDArray[np.float64]
    """(A, I) How much each item contributes to missing each aim: it is met if the sum over the chosen is at most 0."""
    prices: NDArray[np.float64]
    """(A,) Price of missing an aim by 1 on average over N items."""
    groupings: Sequence[Grouping]
    cliques: Sequence[Sequence[int]]
    """Of each of these at most one is chosen."""


def solve_selection(problem: SelectionProblem) -> tuple[int, ...]:
    """Return the chosen items in ascending order. Raises InputError if the solver finds none."""
    from scipy.optimize import Bounds, milp  # only here: a second of imports

    columns = _Columns(problem)
    integral = np.zeros(columns.width)
    integral[: columns.missing_items] = 1
    upper = np.where(integral > 0, 1.0, np.inf)
    limits: Any = (np.zeros(columns.width), upper)  # SciPy takes arrays, but has no types that say so
    found = milp(
        _build_prices(problem, columns),
        integrality=integral,
        bounds=Bounds(*limits),
        constraints=_build_rows(problem, columns),
        options={"mip_rel_gap": RELATIVE_GAP, "node_limit": NODE_LIMIT},
    )
    if found.x is None:
        raise InputError(
            f"selection: expected a choice among {len(problem.costs)} candidates, found none: {found.message}"
        )
    return tuple(int(i) for i in np.flatnonzero(np.asarray(found.x)[: columns.groups] > 0.5))


class _Columns:
    """First column of each kind of variable: items, groups that count, what is missed of items, of groups by grouping
    and of aims, and items too many in a group."""

    def __init__(self, problem: SelectionProblem) -> None:
        sizes = [len(one.groups) for one in problem.groupings]
        self.groups = len(problem.costs)
        self.missing_items = self.groups + sum(sizes)
        self.missing_groups = self.missing_items + 1
        self.missed_aims = self.missing_groups + len(sizes)
        self.crowded = self.missed_aims + len(problem.prices)
        self.width = self.crowded + sum(sizes)
        self.offsets = [sum(sizes[:k]) for k in range(len(sizes))]
        """Of the first group of each grouping among all groups."""


def _build_prices(problem: SelectionProblem, columns: _Columns) -> NDArray[np.float64]:
    prices = np.zeros(columns.width)
    prices[: columns.groups] = problem.costs / problem.count
    prices[columns.missing_items] = _compute_item_price(problem)
    prices[columns.missing_groups : columns.missed_aims] = MISSING_GROUP_PRICE
    prices[columns.missed_aims : columns.crowded] = problem.prices
    prices[columns.crowded :] = MISSING_GROUP_PRICE / problem.count
    return prices


def _compute_item_price(problem: SelectionProblem) -> float:
    """Return the price of an item less than wanted: more than any item can cost, whatever aims it misses."""
    missed = np.abs(problem.excess * problem.prices[:, None]).sum(axis=0)
    dearest = float((missed + np.abs(problem.costs)).max()) / problem.count
    return dearest + 2.0 * MISSING_GROUP_PRICE


def _build_rows(
    problem: SelectionProblem, columns: _Columns
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the rows of the constraints with their least and greatest values."""
    rows: list[NDArray[np.float64]] = []
    bounds: list[tuple[float, float]] = []

    def add(least: float, most: float) -> NDArray[np.float64]:
        rows.append(np.zeros(columns.width))
        bounds.append((least, most))
        return rows[-1]

    row = add(problem.count, problem.count)
    row[: columns.groups] = 1.0
    row[columns.missing_items] = 1.0
    for k, grouping in enumerate(problem.groupings):
        first = columns.groups + columns.offsets[k]
        row = add(grouping.least_groups, np.inf)
        row[first : first + len(grouping.groups)] = 1.0
        row[columns.missing_groups + k] = 1.0
        for g, group in enumerate(grouping.groups, start=columns.offsets[k]):
            row = add(-np.inf, 0.0)
            row[columns.groups + g] = grouping.of_each_group
            row[list(group)] = -1.0
            row = add(-np.inf, grouping.most_of_group)
            row[list(group)] = 1.0
            row[columns.crowded + g] = -1.0
    for k, excess in enumerate(problem.excess):
        row = add(-np.inf, 0.0)
        row[: columns.groups] = excess / problem.count
        row[columns.missed_aims + k] = -1.0
    for clique in problem.cliques:
        add(-np.inf, 1.0)[list(clique)] = 1.0
    least, most = np.array(bounds).T
    return np.array(rows), least, most


def find_cliques(rivals: Sequence[frozenset[int]]) -> tuple[tuple[int, ...], ...]:
    """Return sets of items that exclude each other, so that every pair of rivals is in one of them.

    rivals: those of each item. One bound for a set tells the solver more than one for each of its pairs.
    """
    left = {(i, j) for i, others in enumerate(rivals) for j in others if i < j}
    cliques: list[tuple[int, ...]] = []
    for pair in sorted(left):
        if pair not in left:
            continue
        clique = list(pair)
        for other in sorted(rivals[pair[0]] & rivals[pair[1]]):
            if all(other in rivals[one] for one in clique):
                clique.append(other)
        cliques.append(tuple(sorted(clique)))
        left -= {(a, b) for a in clique for b in clique if a < b}
    return tuple(cliques)
