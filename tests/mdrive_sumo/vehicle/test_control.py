"""Plans as controllers read them, and every controller with any plan."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.control_loop import own, plan_of
from testing.sampling import examples

from mdrive_sumo.contract import Plan
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.vehicle.control import CONTROLLERS
from mdrive_sumo.vehicle.control.plan_reader import find_aim_point, sample_waypoints
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts


def test_waypoints_are_due_on_the_plans_clock() -> None:
    plan = plan_of((1.0, 0.0), (2.0, 0.0), (4.0, 0.0), interval_s=0.5)
    assert sample_waypoints(plan, own(2.0), 0, 0.5, 4)[:, 0] == pytest.approx([1, 2, 4, 6])  # goes on at 4 m/s
    assert sample_waypoints(plan, own(2.0, x=1.5), 15, 0.5, 2)[:, 0] == pytest.approx([1.5, 3.5])  # 0.75 s old
    assert sample_waypoints(plan, own(2.0, x=3.0), 30, 0.5, 2)[:, 0] == pytest.approx([1.0, 1.0])  # overdue


def test_waypoints_and_aim_are_in_the_ego_frame() -> None:
    plan = plan_of((5.0, 6.0), (5.0, 7.0), interval_s=1.0)
    seen = own(1.0, x=5.0, y=5.0, yaw=math.pi / 2)
    assert sample_waypoints(plan, seen, 0, 1.0, 2) == pytest.approx(np.array(((1, 0), (2, 0))), abs=1e-12)
    assert find_aim_point(plan, seen, 0, 5.0) == pytest.approx((5.0, 0.0))
    assert find_aim_point(plan, own(1.0, x=4.0, y=6.0), 0, 0.5) == pytest.approx((0.5, 0.0))


coordinates = st.floats(-200, 200) | st.sampled_from([0.0, 1e-9, -1e-9, 1e6, -1e6])


def repeated(points: list[tuple[float, float]], interval_s: float, repeats: int) -> Plan:
    return Plan(np.repeat(np.array(points), repeats, axis=0), interval_s)


plans = st.builds(
    repeated,
    st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=12),
    st.sampled_from([0.01, 0.05, 0.2, 0.5, 1.0, 10.0]),
    st.integers(1, 4),
)
owns = st.builds(
    EgoState,
    x=coordinates,
    y=coordinates,
    yaw=st.floats(-math.pi, math.pi),
    speed=st.floats(-10, 60),
    acceleration=st.floats(-50, 50),
    yaw_rate=st.floats(-6, 6),
)


@pytest.mark.slow
@settings(max_examples=examples(25, 100), deadline=None)
@given(st.lists(st.tuples(plans, owns, st.integers(0, 300)), min_size=1, max_size=4))
def test_any_plan_gives_a_valid_control(asked: list[tuple[Plan, EgoState, int]]) -> None:
    for factory in CONTROLLERS.values():
        controller = factory(to_vehicle_facts(MKZ_2017))
        for plan, state, age in asked:
            control = controller.follow(plan, state, age)
            assert 0 <= control.throttle <= 1
            assert 0 <= control.brake <= 1
            assert -1 <= control.steer <= 1
            for value in (control.throttle, control.brake, control.steer):
                assert value == round(value, 4)


@settings(max_examples=examples(15, 50), deadline=None)
@given(plans, owns, st.sampled_from(sorted(CONTROLLERS)))
def test_controllers_repeat_themselves(plan: Plan, state: EgoState, name: str) -> None:
    first, second = (CONTROLLERS[name](to_vehicle_facts(MKZ_2017)) for _ in range(2))
    for age in range(6):
        assert first.follow(plan, state, age) == second.follow(plan, state, age)
