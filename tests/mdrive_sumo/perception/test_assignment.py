"""Assignment of measurements to tracks, against scipy as an independent oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from mdrive_sumo.perception.assignment import assign, solve_assignment

pytestmark = pytest.mark.slow  # scipy.optimize is imported


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 10_000))
def test_the_total_cost_is_the_least(rows: int, columns: int, seed: int) -> None:
    cost = np.random.default_rng(seed).uniform(-5, 20, (rows, columns))
    pairs = solve_assignment(cost.tolist())
    assert len(pairs) == min(rows, columns)
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert sum(cost[pair] for pair in pairs) == pytest.approx(cost[linear_sum_assignment(cost)].sum())


@given(st.integers(1, 8), st.lists(st.integers(1, 5), min_size=1, max_size=4), st.integers(0, 9999), st.floats(0, 1))
def test_only_possible_pairs_as_many_as_there_can_be(rows: int, widths: list[int], seed: int, share: float) -> None:
    """Every block of columns on its own, as scipy assigns it."""
    ends = np.cumsum(widths)
    rng = np.random.default_rng(seed)
    cost, possible = rng.uniform(-5, 20, (rows, ends[-1])), rng.uniform(size=(rows, ends[-1])) < share
    starts = ends - widths
    pairs = list(zip(*assign(cost, possible, np.repeat(np.arange(len(widths)), widths)), strict=True))
    assert all(possible[pair] for pair in pairs)
    assert len({column for _, column in pairs}) == len(pairs)
    for low, high in zip(starts, ends, strict=True):
        mine = [pair for pair in pairs if low <= pair[1] < high]
        assert len({row for row, _ in mine}) == len(mine)
        block = np.s_[:, low:high]
        oracle = linear_sum_assignment(np.where(possible[block], cost[block], 1e6))
        best = [pair for pair in zip(*oracle, strict=True) if possible[block][pair]]
        assert len(mine) == len(best)
        assert sum(cost[pair] for pair in mine) == pytest.approx(sum(cost[block][pair] for pair in best))


def test_nothing_fits_to_nothing() -> None:
    rows, columns = assign(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.bool_), np.zeros(3, dtype=np.int64))
    assert len(rows) == len(columns) == 0
