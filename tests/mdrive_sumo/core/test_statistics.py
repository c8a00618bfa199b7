"""Bootstrap intervals of means: of values, of groups (stratified) and of scenarios with several seeds (clustered)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.statistics import (
    bootstrap_clustered_mean,
    bootstrap_mean,
    bootstrap_stratified_clustered_mean,
    bootstrap_stratified_mean,
)


def test_the_interval_of_two_equally_likely_values_is_the_binomial_one() -> None:
    """The mean of 100 draws of 0 or 1 has standard deviation 0.05: 95 % lie within 1.96 of it."""
    found = bootstrap_mean(np.array([0.0, 1.0] * 50))
    assert found.mean == 0.5
    assert found.low == pytest.approx(0.5 - 1.96 * 0.05, abs=0.011)
    assert found.high == pytest.approx(0.5 + 1.96 * 0.05, abs=0.011)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20))
def test_the_interval_is_deterministic_within_the_values_and_clustered_with_one_seed(values: list[float]) -> None:
    found = bootstrap_mean(np.array(values))
    assert found == bootstrap_mean(np.array(values)) == bootstrap_clustered_mean(np.array(values)[:, None])
    slack = 1e-9
    assert min(values) - slack <= found.low <= found.high <= max(values) + slack


def test_a_stratified_mean_resamples_every_group_on_its_own() -> None:
    found = bootstrap_stratified_mean([np.array([0.0, 0.0]), np.array([100.0, 100.0])])
    assert (found.mean, found.low, found.high) == (50.0, 50.0, 50.0)
    spread = bootstrap_stratified_mean([np.random.default_rng(1).normal(50, 10, 400)])
    assert spread.high - spread.low == pytest.approx(2 * 1.96 * 10 / 20, rel=0.15)


def test_seeds_that_agree_add_no_certainty_about_other_scenarios() -> None:
    """Four equal seeds of each of 25 scenarios are 25 values and not 100: the interval is that of one seed."""
    values = np.array([0.0, 1.0] * 50)[:25, None]
    one, four = bootstrap_clustered_mean(values), bootstrap_clustered_mean(np.repeat(values, 4, axis=1))
    assert four.mean == one.mean
    assert (four.low, four.high) == pytest.approx((one.low, one.high), abs=0.02)


def test_seeds_that_differ_widen_the_interval_of_equal_scenarios() -> None:
    """All scenarios are alike, the standard deviation of a seed is 0.5, so that of a mean of 3 x 2 about 0.5 / √6."""
    found = bootstrap_clustered_mean(np.tile([0.0, 1.0], (3, 1)))
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.5 / 6**0.5, abs=0.2)


def test_a_stratified_clustered_mean_weighs_groups_alike_and_resamples_each() -> None:
    same, other = np.full((3, 2), 10.0), np.full((1, 2), 40.0)
    found = bootstrap_stratified_clustered_mean((same, other))
    assert (found.mean, found.low, found.high) == (25.0, 25.0, 25.0)
    seeds = bootstrap_stratified_clustered_mean((np.array([[0.0, 100.0]]),))
    assert (seeds.mean, seeds.low, seeds.high) == (50.0, 0.0, 100.0)  # of one scenario only seeds vary
    assert bootstrap_stratified_clustered_mean((np.arange(6.0).reshape(3, 2),)) == bootstrap_clustered_mean(
        np.arange(6.0).reshape(3, 2)
    )
