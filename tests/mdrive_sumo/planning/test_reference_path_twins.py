"""Reference paths and their follower: the same bits from the Python text and from the compiled layer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Float

ANY = st.floats(allow_nan=True, allow_infinity=True)
NEAR = st.one_of(st.floats(-9.0, 40.0), st.sampled_from((0.0, 0.25, -0.0, 24.75)))
POINTS = st.integers(1, 100).flatmap(
    lambda rows: st.tuples(
        arrays(np.float64, (rows, 2), elements=st.one_of(NEAR, ANY)), arrays(np.float64, rows, elements=NEAR)
    )
)


@given(POINTS, arrays(np.float64, st.integers(0, 9), elements=st.one_of(NEAR, ANY)))
def test_points_at_arc_lengths(path: tuple[Float, Float], s: Float) -> None:
    compare_twins("planning_reference_path_interpolate_points", path[0], s)


def test_points_of_no_path() -> None:
    compare_twins("planning_reference_path_interpolate_points", np.zeros((0, 2)), np.zeros(1))


@given(POINTS, NEAR, NEAR, st.one_of(NEAR, ANY), st.one_of(st.just(10.0), NEAR, ANY))
def test_projection(path: tuple[Float, Float], x: float, y: float, near_s: float, within_m: float) -> None:
    compare_twins("planning_reference_path_project_on_points", *path, x, y, near_s, within_m)


def test_the_first_of_equally_near_points_counts() -> None:
    square = np.array(((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)))
    assert compare_twins("planning_reference_path_project_on_points", square, np.ones(3), 0.0, 0.0, 0.0, 9.0) < 0.25


@given(arrays(np.float64, st.integers(0, 30), elements=st.one_of(NEAR, ANY)), st.one_of(st.just(1.42), ANY), NEAR)
def test_body_yaw(yaw: Float, rear_to_centre: float, first: float) -> None:
    compare_twins("planning_reference_path_integrate_body_yaw", yaw, rear_to_centre, first)


@given(arrays(np.float64, st.integers(0, 30), elements=st.one_of(NEAR, ANY)), st.one_of(st.just(4.0), ANY))
def test_speeds_that_leave_room_to_brake(limits: Float, braking: float) -> None:
    compare_twins("planning_reference_path_limit_to_braking", limits, braking)


@given(
    arrays(np.float64, st.integers(0, 30), elements=st.one_of(NEAR, ANY)),
    st.one_of(NEAR, ANY), st.one_of(NEAR, ANY), st.floats(-9, 9), st.one_of(st.just(0.2), ANY), st.integers(0, 15),
)  # fmt: skip
def test_follower(limits: Float, s: float, speed: float, acceleration: float, dt: float, steps: int) -> None:
    if len(limits):
        compare_twins("planning_path_follower_integrate", limits, s, speed, acceleration, dt, steps)


@given(arrays(np.float64, st.integers(0, 30), elements=st.one_of(NEAR, ANY)), st.integers(0, 31), st.integers(0, 40))
def test_slowest(limits: Float, first: int, count: int) -> None:
    compare_twins("planning_reference_path_find_slowest", limits, first, count)
