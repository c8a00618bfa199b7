"""Assignment of measurements to tracks: most pairs first, then least cost."""

import math
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int

_IMPOSSIBLE = 1e6
"""Cost of a pair that the gate excludes: more than any set of possible pairs."""


@twin
def assign(cost: Float, possible: Bool, blocks: Int, /) -> tuple[Int, Int]:
    """Return rows (K,) and columns (K,) of assigned pairs of a cost matrix (N, M), only `possible` ones, by row.

    blocks: (M,) block of each column, ascending; a row is assigned at most once in each block, a column at most once.
    In every block as many pairs as there can be, of these the cheapest. Pairs without competitors are taken at once;
    the rest is solved by the Hungarian method.
    """
    is_one_block = blocks[:, None] == blocks
    in_row = (possible[:, :, None] & is_one_block).sum(axis=1)
    chosen = possible & (in_row == 1) & (possible.sum(axis=0) == 1)
    contested = possible & ~chosen
    for block in np.unique(blocks[contested.any(axis=0)]).tolist():
        columns = np.flatnonzero((blocks == block) & contested.any(axis=0))
        rows = np.flatnonzero(contested[:, columns].any(axis=1))
        part = np.ix_(rows, columns)
        for i, k in solve_assignment(np.where(contested[part], cost[part], _IMPOSSIBLE).tolist()):
            chosen[rows[i], columns[k]] |= contested[rows[i], columns[k]]
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
    while not done[0] or row_of[column]:
        done[column] = True
        row = row_of[column]
        for other in range(1, width + 1):
            reduced = cost[row - 1][other - 1] - by_row[row] - by_column[other]
            if not done[other] and reduced < least[other]:
                least[other], before[other] = reduced, column
        best, following = min((least[other], other) for other in range(width + 1) if not done[other])
        if best == math.inf:
            raise ValueError("expected finite costs of assignments, found NaN or infinity")
        for other in range(width + 1):
            if done[other]:
                by_row[row_of[other]] += best
                by_column[other] -= best
            else:
                least[other] -= best
        column = following
    while column:
        row_of[column] = row_of[before[column]]
        column = before[column]
