"""Geometry against shapely and against arithmetic that a reader can follow."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import (
    Float,
    Polyline,
    box_corners,
    boxes_corners,
    boxes_overlap,
    build_polyline,
    wrap_angle,
    wrap_angles,
)

coordinate = st.floats(-100, 100)
angle = st.floats(-20, 20)
size = st.floats(0.2, 15)
box = st.tuples(coordinate, coordinate, angle, size, size)


@given(angle)
def test_wrapping_keeps_the_direction(value: float) -> None:
    wrapped = wrap_angle(value)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(value), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(value), abs=1e-9)
    assert math.cos(wrap_angles(np.array([value]))[0] - wrapped) == pytest.approx(1.0)


@given(box)
def test_corners_make_a_box_of_that_size_around_that_centre(values: tuple[float, ...]) -> None:
    x, y, yaw, length, width = values
    corners = box_corners(*values)
    assert np.allclose(corners.mean(axis=0), (x, y), atol=1e-6)
    assert shapely.Polygon(corners).area == pytest.approx(length * width, rel=1e-6)
    assert shapely.Polygon(corners).exterior.is_ccw
    ahead = (corners[0] + corners[3]) / 2 - (x, y)
    assert np.allclose(ahead, np.array((math.cos(yaw), math.sin(yaw))) * length / 2, atol=1e-6)
    many = boxes_corners(*(np.array([value]) for value in values))
    assert np.allclose(many[0], corners)


@given(box, box)
def test_overlap_agrees_with_shapely(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    a, b = box_corners(*first), box_corners(*second)
    shapes = shapely.Polygon(a), shapely.Polygon(b)
    area = shapes[0].intersection(shapes[1]).area
    assume(area > 1e-6 or shapes[0].distance(shapes[1]) > 1e-9)  # touching is decided by rounding
    assert bool(boxes_overlap(a, b)) == (area > 0)


@given(st.lists(box, min_size=1, max_size=4), st.lists(box, min_size=1, max_size=4), st.booleans())
def test_overlap_is_bit_for_bit_that_of_plain_arithmetic(
    first: list[tuple[float, ...]], second: list[tuple[float, ...]], on_a_grid: bool
) -> None:
    """Every pair, one axis after the other; on a grid many boxes touch."""
    a, b = (np.array([box_corners(*values) for values in boxes]) for boxes in (first, second))
    if on_a_grid:
        a, b = np.round(a), np.round(b)

    def is_apart(one: Float, other: Float, axis: Float) -> bool:
        spans = [[float(x) * axis[0] + float(y) * axis[1] for x, y in corners] for corners in (one, other)]
        return max(spans[0]) <= min(spans[1]) or max(spans[1]) <= min(spans[0])

    def overlap(one: Float, other: Float) -> bool:
        return not any(is_apart(one, other, box[i + 1] - box[i]) for box in (one, other) for i in (0, 1))

    assert boxes_overlap(a[:, None], b).tolist() == [[overlap(one, other) for other in b] for one in a]


def test_overlap_is_taken_over_whole_arrays() -> None:
    mine = boxes_corners(*np.array([[0.0, 0.0, 0.0, 4.0, 2.0]]).T)
    others = boxes_corners(*np.array([[3.9, 0.0, 0.0, 4.0, 2.0], [4.1, 0.0, 0.0, 4.0, 2.0]]).T)
    assert boxes_overlap(mine, others).tolist() == [True, False]


def test_a_polyline_measures_and_projects() -> None:
    line = build_polyline([(0, 0), (3, 0), (3, 0), (3, 4)])
    assert line.length == 7.0
    assert line.at(5.0) == (3.0, 2.0)
    assert line.at(-1.0) == (-1.0, 0.0)
    assert line.at(9.0) == (3.0, 6.0)
    assert line.yaw_at(1.0) == 0.0
    assert line.yaw_at(6.9) == pytest.approx(math.pi / 2)
    assert line.project(1.0, 2.0) == (1.0, 2.0)
    assert line.project(4.0, 2.0) == (5.0, -1.0)


@given(st.floats(0, 7), st.floats(-0.5, 0.5))
def test_projection_undoes_offsetting(s: float, d: float) -> None:
    line = build_polyline([(0, 0), (7, 0)])
    x, y = line.at(s)
    found = line.project(x, y + d)
    assert found[0] == pytest.approx(s, abs=1e-9)
    assert found[1] == pytest.approx(d, abs=1e-9)


def test_a_projection_can_be_kept_to_one_branch_of_a_path_that_crosses_itself() -> None:
    line = build_polyline([(0, 0), (10, 0), (10, 10), (5, 10), (5, -5)])
    assert line.project(5.0, 0.1)[0] == pytest.approx(34.9)
    assert line.project(5.0, 0.1, between=(0, 9))[0] == pytest.approx(5.0)


@given(st.floats(0.3, 40.0))
def test_resampling_keeps_ends_and_spacing(length: float) -> None:
    dense = Polyline(np.array([(0.0, 0.0), (length, 0.0)])).resample(1.0)
    assert np.allclose(dense.xy[-1], (length, 0))
    hops = np.diff(dense.xy[:, 0])
    assert np.allclose(hops[:-1], 1.0)
    assert hops[-1] < 1.1 + 1e-6
    assert hops[-1] > 0.1 - 1e-6


@pytest.mark.parametrize("points", [[(0, 0)], [(0, 0), (0, 0)], [(0, 0), (math.nan, 1)]])
def test_no_polyline_without_extent(points: list[tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match="polyline needs"):
        build_polyline(points)
