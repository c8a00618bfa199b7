"""Compiled geometry has the bits of the Python text."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.core.geometry import Polyline, boxes_corners, build_polyline

ANY = st.floats(allow_nan=True, allow_infinity=True)
SOME = st.one_of(st.floats(-50.0, 50.0), st.integers(-9, 9).map(float), st.sampled_from((0.0, -0.0)))


@given(st.one_of(SOME, ANY, st.sampled_from((np.pi, -np.pi))))
def test_wrapping(angle: float) -> None:
    compare_twins("core_geometry_wrap_angle", angle)
    compare_twins("core_geometry_wrap_angles", np.array((angle, -angle)))
    compare_twins("core_geometry_wrap_angles", np.array(angle))


@given(st.tuples(*[st.one_of(SOME, ANY)] * 5))
def test_corners_of_a_box(values: tuple[float, ...]) -> None:
    compare_twins("core_geometry_box_corners", *values)
    compare_twins("core_geometry_boxes_corners", *(np.array((value, value)) for value in values))


@pytest.mark.parametrize(
    ("place", "size"),
    [((), ()), ((3,), (3,)), ((0,), (1,)), ((4, 3), (3,)), ((4, 1), (2, 1, 3)), ((2, 0), (2, 1)), ((3,), (2,))],
)
def test_corners_of_boxes_that_broadcast(place: tuple[int, ...], size: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    x, y, yaw = rng.uniform(-9.0, 9.0, (3, *place))
    length, width = rng.uniform(0.0, 9.0, (2, *size))
    compare_twins("core_geometry_boxes_corners", x, y, yaw, length, width)
    compare_twins("core_geometry_boxes_corners", x, y, yaw.T.copy().T, 4.5, np.float64(1.8))


@given(st.lists(st.tuples(*[SOME] * 5), min_size=1, max_size=3), st.lists(ANY, max_size=3), st.booleans())
def test_overlap(values: list[tuple[float, ...]], odd: list[float], on_a_grid: bool) -> None:
    boxes = boxes_corners(*np.array(values).T)
    if on_a_grid:
        boxes = np.round(boxes)
    boxes.ravel()[: len(odd)] = odd
    compare_twins("core_geometry_boxes_overlap", boxes[:, None], boxes)
    compare_twins("core_geometry_boxes_overlap", boxes[0], boxes[-1])
    compare_twins("core_geometry_boxes_overlap", boxes[:, None][:, :0], boxes)


@pytest.mark.parametrize("shape", [(2, 4, 2), (3, 4, 3), (8,), (1, 1, 1, 1, 1, 4, 2)])
def test_what_are_no_boxes_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises((ValueError, TypeError), match="expected"):
        get_compiled("core_geometry_boxes_overlap")(np.zeros(shape), np.zeros((3, 4, 2)))


LINES = st.lists(st.tuples(SOME, SOME), min_size=2, max_size=6)


@given(LINES, st.one_of(SOME, ANY), st.one_of(SOME, ANY), st.one_of(st.none(), st.tuples(SOME, ANY)))
def test_places_on_a_polyline(points: list[tuple[float, float]], x: float, y: float, between: None) -> None:
    segments = Polyline(np.array(points))._segments
    low, high = between or (-np.inf, np.inf)
    compare_twins("core_geometry__find_segment", segments, x)
    compare_twins("core_geometry__compute_point", segments, x)
    compare_twins("core_geometry__project_on_segments", segments, x, y, low, high)
    compare_twins("core_geometry__project_on_segments", segments, *points[0], low, high)


def test_a_polyline_without_segments_is_refused() -> None:
    segments = build_polyline([(0, 0), (1, 0)])._segments
    for bad in (segments[:0], segments[:, :5], segments[0]):
        with pytest.raises(ValueError, match="expected"):
            get_compiled("core_geometry__find_segment")(bad, 0.0)


def test_segments_that_are_nearly_points() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        points = np.cumsum(rng.choice((1.0, 1e-9, 1e-10, 1e-12), (4, 2)) * rng.choice((1.0, -1.0), (4, 2)), axis=0)
        segments, place = Polyline(points)._segments, points[1] + rng.uniform(-1.0, 1.0, 2) * rng.choice((1.0, 1e-9))
        compare_twins("core_geometry__compute_point", segments, float(segments[-1, 0]) * 1.5)
        compare_twins("core_geometry__project_on_segments", segments, *place.tolist(), -math.inf, math.inf)
