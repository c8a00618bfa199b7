"""Speed intentions: accelerations, trajectories and directions."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.intention import (
    build_line,
    classify_acceleration,
    classify_direction,
    convert_to_acceleration,
    measure_line,
    predict_trajectory,
    replace_slow_keep,
    sample_line,
)
from mdrive_sumo.v2x.messages import Direction, Intention

STRAIGHT = np.array(((0.0, 0.0), (100.0, 0.0)))


@pytest.mark.parametrize(
    ("intention", "nearest", "vehicles", "expected"),
    [
        (Intention.STOP, math.inf, 0, -10.0),
        (Intention.STOP, 5.0, 19, -10.0),
        (Intention.KEEP, 20.0, 3, 0.0),
        (Intention.SLOWER, 50.0, 0, -1.0),
        (Intention.SLOWER, 5.0, 19, -8.0),
        (Intention.FASTER, 50.0, 0, 5.0),
        (Intention.FASTER, 5.0, 19, 1.0),
        (Intention.FASTER, 27.5, 0, 4.0),  # (3 by distance + 5 by number) / 2
        (Intention.FASTER, 50.0, 9, (5 + 1 / (1 / 5 + (1 - 1 / 5) * 9 / 19)) / 2),
    ],
)
def test_intentions_mean_the_documented_accelerations(
    intention: Intention, nearest: float, vehicles: int, expected: float
) -> None:
    assert convert_to_acceleration(intention, nearest, vehicles) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "label"),
    [(-4.1, Intention.STOP), (-4.0, Intention.SLOWER), (-0.6, Intention.SLOWER), (-0.5, Intention.KEEP),
     (0.5, Intention.KEEP), (0.6, Intention.FASTER)],
)  # fmt: skip
def test_labels_of_accelerations(value: float, label: Intention) -> None:
    assert classify_acceleration(value) == label


def test_trajectories_keep_speeds_within_0_and_8() -> None:
    faster = predict_trajectory(STRAIGHT, 6.0, 5.0)
    assert faster.shape == (20, 2)
    assert faster[0] == pytest.approx((6 * 0.2 + 5 * 0.02, 0.0))
    assert np.diff(faster[:, 0])[5:] == pytest.approx(8 * 0.2)  # 8 m/s after 0.4 s
    stopping = predict_trajectory(STRAIGHT, 6.0, -10.0)
    assert stopping[-1] == pytest.approx((1.8, 0.0))  # v^2 / 2 a
    assert predict_trajectory(STRAIGHT, 12.0, 0.0)[0, 0] == pytest.approx(1.6)


def test_trajectories_continue_straight_beyond_their_line() -> None:
    bend = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (3.0, 2.0)))
    points = predict_trajectory(bend, 5.0, 0.0)
    assert points[2] == pytest.approx((3.0, 0.0))
    assert points[-1] == pytest.approx((3.0, 17.0))


@settings(max_examples=50)
@given(st.floats(0, 8), st.floats(-10, 5), st.floats(-3, 3))
def test_trajectories_never_reverse_nor_exceed_8(speed: float, accelerating: float, yaw: float) -> None:
    way = np.array(((0.0, 0.0), (40 * math.cos(yaw), 40 * math.sin(yaw))))
    gone = predict_trajectory(way, speed, accelerating) @ (math.cos(yaw), math.sin(yaw))
    steps = np.diff(np.concatenate(((0.0,), gone)))
    assert (steps > -1e-9).all() and (steps < 8 * 0.2 + 1e-9).all()


def test_keeping_a_low_speed_becomes_going_faster() -> None:
    assert replace_slow_keep(Intention.KEEP, 3.9) == Intention.FASTER
    assert replace_slow_keep(Intention.KEEP, 4.0) == Intention.KEEP
    assert replace_slow_keep(Intention.SLOWER, 1.0) == Intention.SLOWER


def test_a_standing_car_would_go_straight_on() -> None:
    standing = np.zeros((20, 2))
    assert build_line(0.0, 0.0, math.pi / 2, standing)[-1] == pytest.approx((0.0, 1.0))


S = np.arange(0.0, 31.0)
LANE_CHANGE = 1.75 * (1 + np.tanh((S - 15) / 3))


@pytest.mark.parametrize(
    ("x", "y", "direction"),
    [
        (S, 0 * S, Direction.FOLLOW),
        (np.sin(S / 20) * 20, 20 - np.cos(S / 20) * 20, Direction.LEFT),
        (np.sin(S / 20) * 20, np.cos(S / 20) * 20 - 20, Direction.RIGHT),
        (S, LANE_CHANGE, Direction.CHANGE_LEFT),
        (S, -LANE_CHANGE, Direction.CHANGE_RIGHT),
    ],
)
def test_directions_by_the_shape_of_the_line(x: Float, y: Float, direction: Direction) -> None:
    assert classify_direction(np.column_stack((x, y))) == direction


@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=2, max_size=6),
    st.lists(st.floats(0, 40), min_size=1, max_size=5),
)
def test_a_measured_line_agrees_with_walking_along_it(steps: list[tuple[float, float]], stations: list[float]) -> None:
    points = np.cumsum(np.array(steps), axis=0)

    def walk(station: float) -> Float:
        left, last = station, np.zeros(2)
        for start, end in pairwise(points):
            length = math.hypot(*(end - start))
            if length > 1e-6:
                last = (end - start) / length
            if left <= length:
                return start + last * left if length > 1e-6 else start
            left -= length
        return points[-1] + last * left

    expected = [walk(station) for station in stations]
    assert sample_line(measure_line(points), np.array(stations)) == pytest.approx(np.array(expected), abs=1e-5)
