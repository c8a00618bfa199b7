"""Bootstrap intervals of means: of values, of groups (stratified) and of scenarios with several seeds (clustered)."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mdrive_sumo.core.statistics import (
    MIN_UNITS,
    RESAMPLES,
    ConfidenceInterval,
    Verdict,
    bootstrap_clustered_mean,
    bootstrap_mean,
    bootstrap_stratified_clustered_mean,
    bootstrap_stratified_mean,
    compute_kendall,
    compute_spearman,
    describe_too_few,
    draw_resample_counts,
    format_interval_cells,
    judge_interval,
    make_interval,
    sum_resamples,
)


def measure_width(interval: ConfidenceInterval) -> float:
    """Return how wide an interval is."""
    assert interval.ends is not None
    return interval.ends[1] - interval.ends[0]


def test_the_interval_of_two_equally_likely_values_is_the_binomial_one() -> None:
    """The mean of 100 draws of 0 or 1 has standard deviation 0.05: 95 % lie within 1.96 of it."""
    found = bootstrap_mean(np.array([0.0, 1.0] * 50))
    assert found.mean == 0.5
    assert found.ends == pytest.approx((0.5 - 1.96 * 0.05, 0.5 + 1.96 * 0.05), abs=0.011)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20))
def test_the_interval_is_deterministic_within_the_values_and_clustered_with_one_seed(values: list[float]) -> None:
    found = bootstrap_mean(np.array(values))
    assert found == bootstrap_mean(np.array(values)) == bootstrap_clustered_mean(np.array(values)[:, None])
    assert found.units == len(values)
    assert (found.ends is None) == (len(values) < MIN_UNITS)
    if found.ends is not None:
        slack = 1e-9
        assert min(values) - slack <= found.ends[0] <= found.ends[1] <= max(values) + slack


def test_a_stratified_mean_resamples_every_group_on_its_own() -> None:
    found = bootstrap_stratified_mean([np.zeros(MIN_UNITS), np.full(MIN_UNITS, 100.0)])
    assert (found.mean, found.ends) == (50.0, (50.0, 50.0))
    spread = bootstrap_stratified_mean([np.random.default_rng(1).normal(50, 10, 400)])
    assert measure_width(spread) == pytest.approx(2 * 1.96 * 10 / 20, rel=0.15)


def test_seeds_that_agree_add_no_certainty_about_other_scenarios() -> None:
    """Four equal seeds of each of 25 scenarios are 25 values and not 100: the interval is that of one seed."""
    values = np.array([0.0, 1.0] * 50)[:25, None]
    one, four = bootstrap_clustered_mean(values), bootstrap_clustered_mean(np.repeat(values, 4, axis=1))
    assert four.mean == one.mean
    assert four.ends == pytest.approx(one.ends, abs=0.02)


def test_seeds_that_differ_widen_the_interval_of_equal_scenarios() -> None:
    """All scenarios are alike, the standard deviation of a seed is 0.5, so that of a mean of 10 x 2 about 0.5 / √20."""
    found = bootstrap_clustered_mean(np.tile([0.0, 1.0], (10, 1)))
    assert measure_width(found) == pytest.approx(2 * 1.96 * 0.5 / 20**0.5, abs=0.1)


def test_a_stratified_clustered_mean_weighs_groups_alike_and_resamples_each() -> None:
    same, other = np.full((12, 2), 10.0), np.full((10, 2), 40.0)
    found = bootstrap_stratified_clustered_mean((same, other))
    assert (found.mean, found.ends, found.units) == (25.0, (25.0, 25.0), 10)
    values = np.arange(24.0).reshape(12, 2)
    assert bootstrap_stratified_clustered_mean((values,)) == bootstrap_clustered_mean(values)


@pytest.mark.parametrize("units", [1, MIN_UNITS - 1])
def test_too_few_units_give_neither_an_interval_nor_a_verdict(units: int) -> None:
    """Also where all values are alike, and where only one of the groups that are drawn apart is small."""
    few = np.full((units, 3), 26.7)
    many = np.full((50, 3), 26.7)
    for found in (
        bootstrap_mean(few[:, 0]),
        bootstrap_clustered_mean(few),
        bootstrap_stratified_mean((few[:, 0], many[:, 0])),
        bootstrap_stratified_clustered_mean((few, many)),
    ):
        assert (found.mean, found.ends, found.units) == (pytest.approx(26.7), None, units)
        assert (judge_interval(found), found.is_clear) == (Verdict.TOO_FEW, False)
        assert format_interval_cells(found, "+.1f") == ("+26.7", "-", "-")
    assert describe_too_few(units).startswith(f"{units} scenario") and not describe_too_few(MIN_UNITS)
    assert judge_interval(bootstrap_clustered_mean(many)) is Verdict.GAIN


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(-2, -1, "loss"), (-1, 0, "no difference shown"), (0, 0, "no difference shown"), (0, 2, "no difference shown"),
     (0.1, 2, "gain")],
)  # fmt: skip
def test_only_intervals_without_0_show_a_difference(low: float, high: float, verdict: str) -> None:
    assert judge_interval(ConfidenceInterval(0.5 * (low + high), low, high, MIN_UNITS)) == verdict


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
