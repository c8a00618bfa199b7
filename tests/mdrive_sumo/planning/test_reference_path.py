"""Reference paths: curvature, projection, speeds, and the path follower."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.agents_driving import crossing_route

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.path_follower import FOLLOWER, PathFollower
from mdrive_sumo.planning.reference_path import PATH, SPACING_M, ReferencePath, build_path, compute_curve_speeds

REAR = 1.42
STRAIGHT = np.column_stack((np.arange(61.0), np.zeros(61)))


def circle(radius: float, angle: float) -> Float:
    """Route (N, 2) with a hop of 1 m, counter-clockwise from (radius, 0)."""
    turns = np.arange(0.0, angle, 1.0 / radius)
    return radius * np.column_stack((np.cos(turns), np.sin(turns)))


def straight_path() -> ReferencePath:
    return build_path(STRAIGHT, REAR)


@given(radius=st.floats(6.0, 60.0))
def test_a_path_on_a_circle_has_its_curvature_and_stays_near(radius: float) -> None:
    path = build_path(circle(radius, 2.5), REAR)
    inner = slice(round(5 / SPACING_M), round(path.goal_s / SPACING_M) - round(5 / SPACING_M))
    assert path.curvature[inner] == pytest.approx(1 / radius, rel=0.05)
    cut = radius - np.hypot(*path.xy[inner].T)
    assert cut.max() < 2.0**2 / (6 * radius) + 1 / (8 * radius) + 0.02  # moving average, and chords of the 1 m route
    body = math.asin(REAR / radius)  # steady turn: the rear axle runs on the tangent of its own circle
    assert path.yaw[inner][-1] - path.body_yaw[inner][-1] == pytest.approx(body, rel=0.1)


def test_a_path_goes_on_beyond_the_goal() -> None:
    path = straight_path()
    assert path.goal_s == pytest.approx(60.0, abs=0.01)
    assert path.length > path.goal_s + 9.0
    assert path.get_points(np.array([65.0]))[0] == pytest.approx((65.0, 0.0), abs=0.01)


@given(x=st.floats(-3.0, 69.0), y=st.floats(-2.0, 2.0), near=st.floats(-4.0, 4.0))
def test_projection_on_a_straight_path(x: float, y: float, near: float) -> None:
    assert straight_path().project(x, y, x + near) == pytest.approx(max(x, 0.0), abs=1e-6)


def test_a_path_that_leaves_at_an_angle_begins_straight() -> None:
    askew = STRAIGHT @ np.array(((math.cos(0.4), math.sin(0.4)), (-math.sin(0.4), math.cos(0.4))))
    path = build_path(askew, REAR, 0.0)
    assert path.yaw[0] == pytest.approx(0.0, abs=0.05)
    assert path.body_yaw[0] == pytest.approx(0.0)
    far = path.xy[round((PATH.join_m + 4) / SPACING_M) :]
    assert np.abs(far[:, 1] * math.cos(0.4) - far[:, 0] * math.sin(0.4)).max() < 0.02


def test_curve_speeds_keep_within_both_limits() -> None:
    path = build_path(crossing_route("right", 0), REAR)
    speeds = compute_curve_speeds(path, 8.0, 3.0, 2.0)
    assert speeds.max() == 8.0
    assert (speeds**2 * np.abs(path.curvature)).max() <= 3.0 + 1e-9
    assert (-np.diff(speeds**2) / 2 / SPACING_M).max() <= 2.0 + 1e-9


def test_speeds_brake_before_a_lower_limit_and_rise_only_where_a_higher_one_begins() -> None:
    path = straight_path()
    limits = np.where((path.xy[:, 0] >= 30.0) & (path.xy[:, 0] < 50.0), 3.0, 20.0)
    speeds = compute_curve_speeds(path, 25.0, 3.0, 2.0, limits)
    assert np.all(speeds <= limits)
    assert (-np.diff(speeds**2) / 2 / SPACING_M).max() <= 2.0 + 1e-9
    assert speeds[round(29.0 / SPACING_M)] == pytest.approx(np.sqrt(9.0 + 2 * 2.0 * 1.0))
    assert speeds[round(50.0 / SPACING_M)] == 20.0


@given(cruise_speed=st.floats(2.0, 40.0), limit=st.floats(2.0, 40.0), rise=st.floats(0.0, 20.0), at=st.integers(0, 100))
def test_limits_that_never_fall_change_no_speed(cruise_speed: float, limit: float, rise: float, at: int) -> None:
    """To the last digit: digests of routes without a lower limit ahead stay."""
    path = build_path(crossing_route("right", 0), REAR)
    limits = np.where(np.arange(len(path.xy)) < at, limit, limit + rise)
    apart = np.minimum(compute_curve_speeds(path, cruise_speed, 3.0, 2.0), limits)
    together = compute_curve_speeds(path, cruise_speed, 3.0, 2.0, limits)
    assert np.array_equal(apart, together)


def test_the_follower_does_not_run_ahead_of_a_blocked_car() -> None:
    reference = PathFollower(straight_path())
    for _ in range(200):
        reference.update(10.0, 0.0, 0.0)
        reference.advance(2.0, np.full(400, 8.0), 0.05)
    assert reference.s == pytest.approx(10.0 + FOLLOWER.lead_m, abs=0.2)
