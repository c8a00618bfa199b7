"""Assignment of measurements to tracks: most pairs first, then least cost."""

import math
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int

_IMPOSSIBLE = 1e6
"""Cost of a pair that the gate excludes: more than any set of possible pairs."""


def assign(cost: Float, possible: Bool, starts: Int) -> tuple[Int, Int]:
    """Return rows (K,) and columns (K,) of assigned pairs of a cost matrix (N, M), only `possible` ones.

    starts: first column of each block of columns, ascending from 0; a row is assigned at most once in each block, a
    column at most once. In every block as many pairs as there can be, of these the cheapest. Pairs without competitors
    are taken at once; the rest is solved by the Hungarian method.
    """
    if not possible.any():
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    block = np.searchsorted(starts, np.arange(possible.shape[1]), side="right") - 1
    if len(starts) == 1:
        in_row = possible.sum(axis=1)[:, None]
    else:
        in_row = np.add.reduceat(possible.astype(np.int64), starts, axis=1)[:, block]
    clear = possible & (in_row == 1) & (possible.sum(axis=0) == 1)
    contested = possible & ~clear
    chosen, in_contest = clear, contested.any(axis=0)
    for one in sorted(set(block[in_contest].tolist())):
        above = np.flatnonzero((block == one) & in_contest)
        left = np.flatnonzero(contested[:, above].any(axis=1))
        part = np.ix_(left, above)
        for i, k in solve_assignment(np.where(contested[part], cost[part], _IMPOSSIBLE).tolist()):
            chosen[left[i], above[k]] |= contested[left[i], above[k]]
    rows, columns = np.nonzero(chosen)
    return rows, columns


def solve_assignment(cost: Sequence[Sequence[float]]) -> list[tuple[int, int]]:
    """Return the min(N, M) pairs (row, column) of least total cost, by row (shortest augmenting paths; Kuhn, Munkres).

    Source: R. Jonker, A. Volgenant, Computing 38 (1987) 325. Plain Python: contested groups are small.
    """
    if len(cost) > len(cost[0]):
        turned = solve_assignment(list(zip(*cost, strict=True)))
        return sorted((row, column) for column, row in turned)
    count, width = len(cost), len(cost[0])
    by_row, by_column = [0.0] * (count + 1), [0.0] * (width + 1)
    row_of = [0] * (width + 1)
    """Row of each column, counted from 1; 0: free. Column 0 stands for the row that is being placed."""
    for row in range(1, count + 1):
        row_of[0] = row
        _augment(cost, by_row, by_column, row_of)
    return sorted((row_of[column] - 1, column - 1) for column in range(1, width + 1) if row_of[column])


def _augment(cost: Sequence[Sequence[float]], by_row: list[float], by_column: list[float], row_of: list[int]) -> None:
    """Place the row of column 0 along the shortest augmenting path; updates potentials and `row_of`."""
    width = len(by_column) - 1
    least, before, done = [math.inf] * (width + 1), [0] * (width + 1), [False] * (width + 1)
    column = 0
    while True:
        done[column] = True
        row, best, following = row_of[column], math.inf, 0
        for other in range(1, width + 1):
            if done[other]:
                continue
            reduced = cost[row - 1][other - 1] - by_row[row] - by_column[other]
            if reduced < least[other]:
                least[other], before[other] = reduced, column
            if least[other] < best:
                best, following = least[other], other
        for other in range(width + 1):
            if done[other]:
                by_row[row_of[other]] += best
                by_column[other] -= best
            else:
                least[other] -= best
        column = following
        if not row_of[column]:
            break
    while column:
        row_of[column] = row_of[before[column]]
        column = before[column]
