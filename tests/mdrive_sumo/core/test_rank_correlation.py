"""Rank correlations against SciPy, by hand, and as properties."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mdrive_sumo.core.statistics import (
    RESAMPLES,
    bootstrap_mean,
    compute_kendall,
    compute_spearman,
    draw_resample_counts,
    make_interval,
    sum_resamples,
)

SAMPLES = st.integers(3, 9).flatmap(
    lambda size: st.tuples(*[arrays.arrays(np.float64, size, elements=st.integers(0, 4))] * 2)
)
"""Two rows of few different values, so that ties are frequent."""


@pytest.mark.slow  # scipy.stats is imported
@given(SAMPLES)
def test_they_are_those_of_scipy(pair: tuple[np.ndarray, np.ndarray]) -> None:
    from scipy import stats

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # all values tied: NaN there and here
        expected = stats.spearmanr(*pair)[0], stats.kendalltau(*pair)[0]
    found = float(compute_spearman(*pair)), float(compute_kendall(*pair))
    assert found == pytest.approx(expected, abs=1e-12, nan_ok=True)


def test_by_hand() -> None:
    order, other = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 3.0, 2.0, 4.0])
    assert float(compute_kendall(order, other)) == pytest.approx(4 / 6)  # 5 pairs agree, 1 does not
    assert float(compute_spearman(order, other)) == pytest.approx(1 - 6 * 2 / (4 * 15))
    assert float(compute_kendall(order, -order)) == float(compute_spearman(order, -order)) == -1.0


def test_many_rows_at_once_and_values_that_differ_in_the_last_bit() -> None:
    x = np.array([[0.1 + 0.2, 0.3, 0.5], [1.0, 2.0, 3.0]])
    y = np.array([[1.0, 1.0, 2.0], [3.0, 2.0, 1.0]])
    assert compute_spearman(x, y).tolist() == pytest.approx([1.0, -1.0])
    assert compute_kendall(x, y).tolist() == pytest.approx([1.0, -1.0])


def test_resample_counts_give_the_interval_of_a_mean() -> None:
    values = np.array([0.0, 1.0, 5.0, 9.0, 10.0] * 2)
    counts = draw_resample_counts(len(values))
    assert counts.shape == (1 + RESAMPLES, 10)
    assert counts[0].tolist() == [1.0] * 10 and set(counts.sum(axis=1)) == {10.0}
    found, expected = make_interval(5.0, sum_resamples(counts, values)[1:] / 10, 10), bootstrap_mean(values)
    assert found.ends is not None and found.ends == pytest.approx(expected.ends)
    assert sum_resamples(counts, np.stack((values, -values), axis=-1)).sum() == 0
