"""Right of way by observation: precedence, lead objects, predicted turns."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Objects, VehicleFacts
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.reference_path import build_path

REAR = 1.42


def cars(*rows: tuple[float, float, float, float]) -> Objects:
    """Cars of x, y [m], yaw [rad], speed [m/s]."""
    x, y, yaw, speed = np.array(rows).reshape(-1, 4).T
    names = tuple(f"b{i}" for i in range(len(rows)))
    kind = np.full(len(rows), Kind.VEHICLE, dtype=np.uint8)
    return Objects(names, kind, x, y, yaw, speed, np.full(len(rows), 4.5), np.full(len(rows), 1.8))


def mover(speed: float = 8.0) -> right_of_way.EgoMotion:
    return right_of_way.EgoMotion((0.0, 0.0), speed, 8.0, 2.0)


def crossing(
    bearing: float, arrives_s: float, leaves_s: float, x: float = 9.0, turning: bool = False
) -> right_of_way.CrossingConflict:
    return right_of_way.CrossingConflict("t", 16.0, 22.0, arrives_s, leaves_s, False, bearing, turning, (x, 0.0))


@pytest.mark.parametrize(
    ("other", "yields"),
    [
        (crossing(math.pi / 2, 1.0, 2.0), True),  # it is there first: 2 s to my 16 m
        (crossing(math.pi / 2, 3.0, 4.0), False),  # I am there first
        (crossing(math.pi / 2, 2.1, 3.0), True),  # tie, it comes from my right
        (crossing(-math.pi / 2, 2.1, 3.0), False),  # tie, it comes from my left
        (crossing(math.pi, 2.1, 3.0, turning=True), True),  # tie, oncoming, I turn
        (crossing(math.pi, 2.1, 3.0, x=-9.0), True),  # tie, oncoming, the one further west goes
        (crossing(math.pi, 2.1, 3.0, x=9.0), False),
        (crossing(math.pi / 2, 0.1, 0.9), False),  # gone before I come
    ],
)
def test_right_of_way(other: right_of_way.CrossingConflict, yields: bool) -> None:
    assert right_of_way.must_yield(mover(), other, yielded_before=False, is_impatient=False) is yields


def test_yielding_continues_unless_the_car_is_impatient() -> None:
    slightly_later = crossing(math.pi / 2, 3.0, 4.0)
    assert right_of_way.must_yield(mover(), slightly_later, yielded_before=True, is_impatient=False)
    assert not right_of_way.must_yield(mover(), slightly_later, yielded_before=True, is_impatient=True)


@given(speed=st.floats(0.0, 12.0), distance=st.floats(0.0, 100.0))
def test_time_to_a_distance_is_the_motion_inverted(speed: float, distance: float) -> None:
    t = mover(speed=speed).compute_time_to(distance)
    cruise = max(8.0, speed)
    ramp = min(t, (cruise - speed) / 2.0)
    assert speed * ramp + ramp**2 + cruise * (t - ramp) == pytest.approx(distance, abs=1e-6)


def test_lead_objects_exclude_followers_beside() -> None:
    path = build_path(np.column_stack((np.arange(61.0), np.zeros(61))), REAR)
    ahead = right_of_way.preview_path(path, 10.0, _vehicle())
    found = right_of_way.find_lead_objects(
        mover(), ahead, cars((30.0, 0.0, 0.0, 3.0), (30.0, 3.5, 0.0, 3.0), (8.0, 1.5, 0.0, 8.0))
    )
    assert len(found) == 1
    assert found[0].gap_m == pytest.approx(30 - 2.25 - 10 - 2.45, abs=1.0)
    assert found[0].speed == 3.0
    assert found[0].position == (30.0, 0.0)


def test_a_turning_car_is_expected_to_turn_on() -> None:
    memory = right_of_way.CurvatureEstimator()
    memory.update(cars((0.0, 0.0, 0.0, 5.0)), 0.2)
    assert memory.update(cars((1.0, 0.0, 0.1, 5.0)), 0.2) == pytest.approx([0.1])
    assert memory.update(cars(), 0.2).shape == (0,)


def _vehicle() -> VehicleFacts:
    return VehicleFacts(4.9, 2.0, 2.845, REAR, 2080.0, 0.75, 58.0, 4.5, 8.0)
