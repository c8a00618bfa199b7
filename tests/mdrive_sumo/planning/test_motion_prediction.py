"""How far the others are expected to come, and where that is."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.motion_prediction import (
    TIMES,
    get_top_speed,
    place_on_arc,
    place_on_path,
    predict_acceleration,
    predict_constant_speed,
    predict_hesitation,
    predict_yielding,
)
from mdrive_sumo.planning.parameters import MOTION
from mdrive_sumo.planning.reference_path import build_path

SPEEDS = st.floats(0.0, 15.0)
REAR = 1.42


def one(x: float, y: float, yaw: float, speed: float, kind: Kind = Kind.VEHICLE) -> Objects:
    """One object."""
    row = (np.array([value]) for value in (x, y, yaw, speed, 4.5, 1.8))
    return Objects(("b",), np.array([kind], dtype=np.uint8), *row)


@given(SPEEDS)
def test_predictions_never_reverse(speed: float) -> None:
    for travelled in (
        predict_constant_speed(speed),
        predict_acceleration(speed),
        predict_hesitation(speed),
        predict_yielding(speed),
    ):
        assert travelled.shape == TIMES.shape
        assert travelled[0] >= 0
        assert np.diff(travelled).min() >= -1e-9


@given(SPEEDS)
def test_hesitation_constant_speed_and_acceleration_are_ordered(speed: float) -> None:
    assert np.all(predict_hesitation(speed) <= predict_constant_speed(speed) + 1e-9)
    assert np.all(predict_constant_speed(speed) <= predict_acceleration(speed) + 1e-9)
    assert np.all(predict_yielding(speed) <= predict_constant_speed(speed) + 1e-9)


@given(SPEEDS)
def test_a_yielding_road_user_stops_after_reaction_and_braking_distance(speed: float) -> None:
    way = speed * MOTION.reaction_s + speed**2 / (2 * MOTION.yielding_braking)
    assert predict_yielding(speed)[-1] == pytest.approx(way, abs=1e-9)


@given(SPEEDS, SPEEDS)
def test_a_faster_road_user_is_predicted_further_ahead(one_speed: float, other_speed: float) -> None:
    slow, fast = sorted((one_speed, other_speed))
    for motion in (predict_constant_speed, predict_acceleration, predict_hesitation, predict_yielding):
        assert np.all(motion(slow) <= motion(fast) + 1e-9)


def test_acceleration_ends_at_the_top_speed() -> None:
    rates = np.diff(predict_acceleration(0.0)) / np.diff(TIMES)
    assert predict_acceleration(0.0)[0] == pytest.approx(TIMES[0] ** 2)  # 2 m/s2
    assert rates[-1] == pytest.approx(MOTION.top_speed)
    assert rates.max() <= MOTION.top_speed + 1e-9
    assert predict_acceleration(12.0) == pytest.approx(12.0 * TIMES)  # a faster road user keeps its speed


def test_hesitation_costs_1_5_m_per_second() -> None:
    assert np.diff(predict_hesitation(8.0))[-1] == pytest.approx(6.5 * (TIMES[-1] - TIMES[-2]))
    assert np.all(predict_hesitation(1.0)[TIMES >= 1.0] == predict_hesitation(1.0)[-1])


@given(st.floats(-0.2, 0.2), st.floats(-3.0, 3.0), st.floats(0.5, 10.0))
def test_a_circle_keeps_its_radius_and_begins_tangentially(curvature: float, yaw: float, speed: float) -> None:
    poses = place_on_arc(one(5.0, -2.0, yaw, speed), 0, predict_constant_speed(speed), curvature)
    turned = poses[:, 2] - yaw
    assert np.abs(turned).max() <= math.pi / 2 + 1e-9
    whole = np.abs(curvature * predict_constant_speed(speed)) <= math.pi / 2
    if abs(curvature) > 1e-3:
        centre = np.array((5.0 - math.sin(yaw) / curvature, -2.0 + math.cos(yaw) / curvature))
        radii = np.hypot(*(poses[whole, :2] - centre).T)
        assert radii == pytest.approx(np.full(whole.sum(), 1 / abs(curvature)), rel=1e-6)
    assert turned[whole] == pytest.approx((curvature * predict_constant_speed(speed))[whole], abs=1e-9)


def test_straight_on_is_a_circle_without_curvature() -> None:
    poses = place_on_arc(one(1.0, 2.0, math.pi / 2, 4.0), 0, predict_constant_speed(4.0), 0.0)
    assert poses[:, 0] == pytest.approx(1.0)
    assert poses[:, 1] == pytest.approx(2.0 + 4.0 * TIMES)


def bent_route() -> Float:
    """20 m east, then 30 m north."""
    east = np.column_stack((np.arange(20.0), np.zeros(20)))
    return np.vstack((east, np.column_stack((np.full(31, 20.0), np.arange(31.0)))))


def test_an_object_on_a_path_follows_its_bends() -> None:
    path = build_path(bent_route(), REAR)
    poses = place_on_path(path, 5.0, predict_constant_speed(5.0))
    at = [int(np.argmin(np.abs(TIMES - t))) for t in (1.0, 5.0)]
    assert poses[at[0]] == pytest.approx((10.0, 0.0, 0.0), abs=0.05)
    assert poses[at[1], 0] == pytest.approx(20.0, abs=0.05)
    assert poses[at[1], 2] == pytest.approx(math.pi / 2, abs=0.01)
    assert place_on_path(path, 5.0, predict_constant_speed(0.0))[-1] == pytest.approx((5.0, 0.0, 0.0), abs=0.05)


def test_pedestrians_stay_slow() -> None:
    assert get_top_speed(one(0, 0, 0, 1, Kind.PEDESTRIAN), 0) == MOTION.walking_top_speed
    assert get_top_speed(one(0, 0, 0, 1), 0) == MOTION.top_speed
    assert get_top_speed(one(0, 0, 0, 1), 0, 20.0) == 20.0
    assert predict_acceleration(1.0, MOTION.walking_top_speed)[-1] < MOTION.walking_top_speed * TIMES[-1]
