"""The paper's controllers: the arithmetic by hand, and a corner in a closed loop."""

import math

import numpy as np
import pytest
from testing.control_loop import drive, own, plan_of, straight_plan, turn

from mdrive_sumo.contract import CONTROL_STEP, Control
from mdrive_sumo.core.window_pid import WindowPid
from mdrive_sumo.vehicle.control import round_control
from mdrive_sumo.vehicle.control.pid import B2D, LMDRIVE, CarlaPid, DualPid, V2xController
from mdrive_sumo.vehicle.dynamics import VehicleState


def test_window_pid_by_hand() -> None:
    pid = WindowPid((5.0, 1.0, 0.1), 4)
    assert pid(0.2) == pytest.approx(5 * 0.2 + 0.2 / 4 + 0.1 * 0.2)
    assert pid(0.3) == pytest.approx(5 * 0.3 + 0.5 / 4 + 0.1 * 0.1)
    for error in (0.1, 0.1, 0.1):
        last = pid(error)
    assert last == pytest.approx(5 * 0.1 + 0.6 / 4 + 0.0)  # 0.2 has left the window


def test_v2x_by_hand_and_holds_for_four_ticks() -> None:
    controller, plan = V2xController(max_speed=5.0), straight_plan(4.0)
    # error min(4 - 3.9, 0.35) = 0.1: 5 x 0.1 + 1 x 0.1 / 20 + 0.1 x 0.1
    expected = round_control(0.5 + 0.005 + 0.01, 0.0, 0.0)
    answers = [
        controller.follow(plan, own(3.9), 0),
        *(controller.follow(plan, own(0.0), k) for k in (1, 2, 3)),
    ]
    assert answers == [expected] * 4
    assert controller.follow(plan, own(0.0), 4) == round_control(0.75, 0.0, 0.0)


def test_v2x_brakes_above_110_percent_of_the_scaled_speed() -> None:
    plan = straight_plan(4.0)
    for scale, desired in ((5.0, 4.0), (8.0, 6.4)):
        assert V2xController(scale).follow(plan, own(1.09 * desired), 0).brake == 0.0
        assert V2xController(scale).follow(plan, own(1.11 * desired), 0) == Control(0.0, 1.0, 0.0)


def test_v2x_steers_by_the_angle_to_the_aim() -> None:
    plan = plan_of(*[(0.6 * (k + 1), 0.8 * (k + 1)) for k in range(20)])
    angle = math.atan2(0.8, 0.6) / (math.pi / 2)
    expected = angle * (1.0 + 0.2 / 5 + 0.1)
    assert V2xController(5.0).follow(plan, own(4.0), 0).steer == pytest.approx(expected, abs=CONTROL_STEP)
    assert V2xController(5.0).follow(plan, own(0.0), 0).steer == 0.0


def test_v2x_starts_by_force_after_101_decisions_of_standing() -> None:
    controller, plan = V2xController(5.0), straight_plan(0.0)
    decisions = [controller.follow(plan, own(0.0), 0).throttle for _ in range(4 * 115)][::4]
    assert decisions == [0.0] * 100 + [0.8] * 12 + [0.0] * 3


def test_carla_pid_by_hand() -> None:
    controller, plan = CarlaPid(target_kmh=21.6), straight_plan(10.0)
    # speed error in km/h: 21.6 - 21.42 = 0.18; first call: P only
    assert controller.follow(plan, own(5.95), 0) == Control(0.75, 0.0, 0.0)
    # then 21.6 - 21.492 = 0.108: 5 x 0.108 + 1 x 0.288 x 0.05 + 0.1 x (-0.072) / 0.05
    assert controller.follow(plan, own(5.97), 1).throttle == pytest.approx(0.54 + 0.0144 - 0.144, abs=CONTROL_STEP)
    assert controller.follow(plan, own(9.0), 2) == Control(0.0, 0.5, 0.0)


def test_carla_pid_turns_the_wheel_slowly_and_to_80_percent() -> None:
    halfway, side = (
        plan_of((5.0, 5.0), (10.0, 10.0), interval_s=1.0),
        plan_of((0.0, 5.0), (0.0, 10.0), interval_s=1.0),
    )
    controller = CarlaPid(target_kmh=28.8)
    steer = [controller.follow(halfway, own(2.0), 0).steer for _ in range(12)]
    assert steer[:3] == [0.1, 0.2, 0.3]
    # 0.5 x 45 degrees + 0.05 x ten errors x 0.05 s
    angle = math.pi / 4
    assert steer[-1] == pytest.approx(0.5 * angle + 0.05 * 10 * angle * 0.05, abs=CONTROL_STEP)
    controller = CarlaPid(target_kmh=28.8)
    assert [controller.follow(side, own(2.0), 0).steer for _ in range(12)][-1] == 0.8


def test_dual_pids_by_hand() -> None:
    plan = straight_plan(4.0)
    assert DualPid(B2D).follow(plan, own(4.5), 0) == Control(0.0, 1.0, 0.0)
    # b2d sees at most 0.25, LMDrive 0.35: 0.1 x (5 + 0.5 / 40 + 1.0)
    for setting in (B2D, LMDRIVE):
        expected = 0.1 * (5 + 0.5 / 40 + 1.0)
        answer = DualPid(setting).follow(plan, own(3.9), 0)
        assert (answer.throttle, answer.brake) == (pytest.approx(expected, abs=CONTROL_STEP), 0.0)
    slow = straight_plan(0.3)
    assert DualPid(B2D).follow(slow, own(0.0), 0).brake == 1.0
    assert DualPid(LMDRIVE).follow(slow, own(0.0), 0).throttle == 0.75
    tilted = plan_of(*[(0.6 * (k + 1), 0.8 * (k + 1)) for k in range(20)])
    angle = math.atan2(0.8, 0.6) / (math.pi / 2)
    for setting, p in ((B2D, 0.75), (LMDRIVE, 1.25)):
        expected_steer = angle * (p + 0.75 / 40 + 0.3)
        assert DualPid(setting).follow(tilted, own(4.0), 0).steer == pytest.approx(
            min(1.0, expected_steer), abs=CONTROL_STEP
        )


MEASURED = {"v2x-5": 0.65, "carla-pid-6": 1.95, "carla-pid-8": 1.95, "b2d": 1.01, "dual-pid": 0.36}
"""Worst lateral error [m] in a quarter circle of 8 m radius at 5 m/s, measured; the gains are the paper's."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MEASURED))
def test_paper_controllers_get_round_a_corner(name: str) -> None:
    rows = drive(name, turn(8.0), lambda t: 5.0 * t, 16.0, 1, VehicleState(0, 0, 0, vx=5.0))
    assert np.abs(rows[:, 1]).max() == pytest.approx(MEASURED[name], abs=0.15)
    assert abs(rows[-1, 1]) < 0.25
