"""Filled polygons: the compiled function against the Python text, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.sensing.polygon_fill import fill_polygons

PLACES = st.one_of(
    st.integers(-3, 40).map(float), st.integers(-3, 40).map(lambda n: n + 0.5), st.floats(-50.0, 90.0),
    st.sampled_from((-1e300, 1e300, -0.0)),
)  # fmt: skip
POINTS = st.tuples(PLACES, PLACES)


@given(
    rings=st.lists(st.tuples(st.integers(0, 2), st.lists(POINTS, min_size=1, max_size=7)), max_size=4),
    single=st.lists(st.tuples(st.integers(0, 2), POINTS, POINTS), max_size=2),
    size=st.sampled_from((0, 1, 7, 8, 9, 33)),
)
def test_any_polygons(
    rings: list[tuple[int, list[tuple[float, float]]]],
    single: list[tuple[int, tuple[float, float], tuple[float, float]]],
    size: int,
) -> None:
    """Also edges that are no ring, whose winding goes on."""
    rows = [(layer, a, b) for layer, ring in rings for a, b in zip(ring, ring[1:] + ring[:1], strict=True)] + single
    edges = np.array([(a, b) for _, a, b in rows], dtype=np.float64).reshape(-1, 2, 2)
    compare_twins("sensing_polygon_fill_fill_polygons", edges, np.array([row[0] for row in rows], np.int64), (3, size))


def test_a_winding_number_that_is_too_large_for_its_bits() -> None:
    square = np.array(((2.0, 2.0), (2.0, 6.0), (6.0, 6.0), (6.0, 2.0)))
    edges = np.tile(np.stack((square, np.roll(square, -1, axis=0)), axis=1), (256, 1, 1))
    filled = compare_twins("sensing_polygon_fill_fill_polygons", edges, np.zeros(len(edges), np.int64), (1, 8))
    assert not filled.any()


@pytest.mark.parametrize(("x", "layer", "shape"), [
    (1.0, 3, (3, 8)), (1.0, -1, (3, 8)), (math.nan, 0, (3, 8)), (1.0, 0, (3, -1)), (1.0, 0, (10**6, 8)),
])  # fmt: skip
def test_what_no_image_shows_is_refused(x: float, layer: int, shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="expected"):
        fill_polygons(np.array((((x, 0.0), (x, 9.0)),)), np.array((layer,)), shape)
