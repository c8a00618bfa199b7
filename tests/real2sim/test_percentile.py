"""Percentiles have the bits of NumPy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mdrive_sumo.core.geometry import Float
from real2sim.percentile import compute_median, compute_percentile

VALUES = st.integers(1, 9).flatmap(
    lambda n: arrays(np.float64, n, elements=st.one_of(st.floats(-1e9, 1e9), st.just(np.nan)))
)


@given(values=VALUES, percent=st.one_of(st.sampled_from((0, 5, 25, 50, 95, 98, 100)), st.floats(0.0, 100.0)))
def test_percentiles_are_those_of_numpy(values: Float, percent: float) -> None:
    np.testing.assert_array_equal(compute_percentile(values, percent), np.percentile(values, percent))
    np.testing.assert_array_equal(compute_median(values), np.median(values))


def test_no_values_have_no_percentile() -> None:
    assert np.isnan(compute_median(np.zeros(0))) and np.isnan(compute_percentile(np.zeros(0), 95))
