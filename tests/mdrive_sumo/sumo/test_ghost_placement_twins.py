"""Boxes near the corridors of lanes: the same pairs from the Python text and from the compiled layer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sumo.ghost_placement import find_near_pairs

NUMBERS = st.one_of(st.integers(-3, 3).map(float), st.floats(-9, 9), st.floats(allow_nan=True))


@given(
    arrays(np.float64, st.tuples(st.integers(0, 3), st.just(4), st.just(2)), elements=NUMBERS),
    arrays(np.float64, st.tuples(st.integers(0, 4), st.just(4)), elements=NUMBERS),
)
def test_pairs(corners: Float, bounds: Float) -> None:
    compare_twins("sumo_ghost_placement_find_near_pairs", corners, bounds)


def test_bounds_that_touch_are_near() -> None:
    box = np.array([[(1.0, 1.0), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0)]])
    bounds = np.array([(1.0, -5.0, 2.0, 0.0), (1.1, 0.0, 2.0, 1.0), (-1.0, -1.0, 3.0, 3.0)])
    assert find_near_pairs(box, bounds) == [(0, 0), (0, 2)]


def test_bounds_that_touch_are_near_in_both_texts() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        compare_twins(
            "sumo_ghost_placement_find_near_pairs",
            *(rng.integers(-3, 4, shape).astype(float) for shape in ((3, 4, 2), (4, 4))),
        )
