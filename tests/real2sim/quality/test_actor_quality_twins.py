"""Compiled figures of an actor have the bits of the Python text."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Float

COSTS = st.one_of(st.floats(0.0, 100.0), st.sampled_from((0.0, 1.0, np.inf, np.nan)))
SHAPES = st.tuples(st.integers(0, 6), st.sampled_from((1, 3, 11)))


@given(costs=SHAPES.flatmap(lambda shape: arrays(np.float64, shape, elements=COSTS)))
def test_time_warping(costs: Float) -> None:
    if len(costs):
        compare_twins("real2sim_quality_actor_quality__sum_least_costs", costs)
