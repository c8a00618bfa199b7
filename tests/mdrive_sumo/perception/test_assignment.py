"""Assignment of measurements to tracks, against scipy as an independent oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from mdrive_sumo.perception.assignment import assign, solve_assignment


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 10_000))
def test_the_total_cost_is_the_least(rows: int, columns: int, seed: int) -> None:
    cost = np.random.default_rng(seed).uniform(-5, 20, (rows, columns))
    pairs = solve_assignment(cost.tolist())
    assert len(pairs) == min(rows, columns)
    assert len({row for row, _ in pairs}) == len({column for _, column in pairs}) == len(pairs)
    assert sum(cost[pair] for pair in pairs) == pytest.approx(cost[linear_sum_assignment(cost)].sum())


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_only_possible_pairs_as_many_as_there_can_be(rows: int, columns: int, seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    cost, possible = rng.uniform(-5, 20, (rows, columns)), rng.uniform(size=(rows, columns)) < share
    pairs = assign(cost, possible)
    assert all(possible[pair] for pair in pairs)
    oracle = linear_sum_assignment(np.where(possible, cost, 1e6))
    best = [pair for pair in zip(*oracle, strict=True) if possible[pair]]
    assert len(pairs) == len(best)
    assert sum(cost[pair] for pair in pairs) == pytest.approx(sum(cost[pair] for pair in best))


def test_nothing_fits_to_nothing() -> None:
    assert assign(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.bool_)) == []
    assert assign(np.zeros((2, 0)), np.zeros((2, 0), dtype=np.bool_)) == []
