"""Controllers: the arithmetic by hand, closed loops with the plant, and every odd plan."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.contract import CONTROL_STEP, Control, Plan
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.core.state import DT, EgoState
from mdrive_sumo.vehicle.control import CONTROLLERS, round_control
from mdrive_sumo.vehicle.control.pid import B2D, LMDRIVE, CarlaPid, DualPid, V2xController, WindowPid
from mdrive_sumo.vehicle.control.plan_reader import find_aim_point, sample_waypoints
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleState, step, to_ego_state, to_vehicle_facts

Profile = Callable[[float], float]
"""Arc length [m] over time [s]."""


def plan_of(*points: tuple[float, float], interval_s: float = 0.2) -> Plan:
    return Plan(np.array(points, dtype=float), interval_s)


def straight_plan(speed: float, interval_s: float = 0.2, count: int = 20) -> Plan:
    return plan_of(*[(speed * interval_s * (k + 1), 0.0) for k in range(count)], interval_s=interval_s)


def own(speed: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> EgoState:
    return EgoState(x, y, yaw, speed)


def turn(radius: float, left: bool = True, run: float = 30.0) -> Polyline:
    """Straight, a quarter circle, straight; points 0.1 m apart."""
    side = 1.0 if left else -1.0
    angles = np.arange(0.0, math.pi / 2, 0.1 / radius)
    before = [(x, 0.0) for x in np.arange(0.0, run, 0.1)]
    arc = [(run + radius * math.sin(a), side * radius * (1 - math.cos(a))) for a in angles]
    after = [(run + radius, side * (radius + y)) for y in np.arange(0.0, 90.0, 0.1)]
    return build_polyline(before + arc + after)


def circle(radius: float) -> Polyline:
    angles = np.arange(0.0, 4 * math.pi, 0.1 / radius)
    return build_polyline([(radius * math.sin(a), radius * (1 - math.cos(a))) for a in angles])


def drive(name: str, path: Polyline, wanted: Profile, seconds: float, hold: int, body: VehicleState) -> Float:
    """Closed loop; a plan of 4 s is made every `hold` ticks. Rows: s error [m], lateral error [m], speed [m/s]."""
    controller = CONTROLLERS[name](to_vehicle_facts(MKZ_2017))
    rows: list[tuple[float, float, float]] = []
    plan = straight_plan(0.0)
    for tick in range(round(seconds / DT)):
        if tick % hold == 0:
            plan = plan_of(*[path.at(wanted(tick * DT + 0.2 * (k + 1))) for k in range(20)])
        body = step(body, controller.follow(plan, to_ego_state(body), tick % hold), MKZ_2017)
        due = wanted((tick + 1) * DT)
        s, d = path.project(body.x, body.y, between=(due - 10.0, due + 10.0))
        rows.append((due - s, d, body.vx))
    return np.array(rows)


def stopping(speed: float, deceleration: float, after_s: float) -> Profile:
    def wanted(t: float) -> float:
        braked = min(max(0.0, t - after_s), speed / deceleration)
        return speed * (min(t, after_s) + braked) - deceleration * braked**2 / 2

    return wanted


STRAIGHT = build_polyline(((0.0, 0.0), (500.0, 0.0)))


# The tracker.


@pytest.mark.parametrize("hold", [1, 10])
@pytest.mark.parametrize(
    ("path", "speed"),
    [
        (turn(8.0), 5.0),
        (turn(8.0, left=False), 5.0),
        (turn(20.0), 8.0),
        (turn(40.0), 12.0),
        (circle(20.0), 8.0),
    ],
)
def test_tracker_keeps_within_15_cm(path: Polyline, speed: float, hold: int) -> None:
    rows = drive("tracker", path, lambda t: speed * t, 12.0, hold, VehicleState(0, 0, 0, vx=speed))
    assert np.abs(rows[:, 1]).max() < 0.15
    assert np.abs(rows[:, 0]).max() < 0.5
    assert rows[-1, 2] == pytest.approx(speed, abs=0.1)


@pytest.mark.parametrize("hold", [1, 10])
@pytest.mark.parametrize(("speed", "deceleration"), [(5.0, 1.0), (8.0, 2.0), (12.0, 4.0)])
def test_tracker_stops_softly_at_the_point(speed: float, deceleration: float, hold: int) -> None:
    wanted = stopping(speed, deceleration, 3.0)
    rows = drive("tracker", STRAIGHT, wanted, 3.0 + speed / deceleration + 2.0, hold, VehicleState(0, 0, 0, vx=speed))
    assert abs(rows[-1, 0]) < 0.02
    assert rows[-1, 2] == 0.0
    assert np.diff(rows[:, 2]).min() / DT > -1.2 * deceleration - 0.5
    assert (rows[-20:, 2] == 0.0).all()


def test_tracker_starts_from_standstill() -> None:
    rows = drive(
        "tracker", STRAIGHT, lambda t: min(t, 4.0) ** 2 + 8 * max(0.0, t - 4.0), 8.0, 10, VehicleState(0, 0, 0)
    )
    assert np.abs(rows[:, 0]).max() < 0.2
    assert rows[-1, 2] == pytest.approx(8.0, abs=0.05)


@pytest.mark.parametrize("speed", [3.0, 8.0, 15.0, 25.0])
def test_tracker_returns_to_its_line(speed: float) -> None:
    rows = drive("tracker", STRAIGHT, lambda t: speed * t, 8.0, 1, VehicleState(0, 1.0, 0.1, vx=speed))
    assert rows[:, 1].min() > -0.5
    assert abs(rows[-1, 1]) < 0.01


def test_tracker_stops_when_the_plan_is_overdue() -> None:
    controller, body, plan = (
        CONTROLLERS["tracker"](to_vehicle_facts(MKZ_2017)),
        VehicleState(0, 0, 0, vx=5.0),
        straight_plan(5.0),
    )
    for age in range(300):
        body = step(body, controller.follow(plan, to_ego_state(body), age), MKZ_2017)
    assert body.vx == 0.0
    assert 19.5 < body.x < 24.0  # 4 s of plan at 5 m/s, then a hard stop


@pytest.mark.parametrize("interval_s", [0.05, 0.5, 1.0])
def test_tracker_follows_single_points(interval_s: float) -> None:
    """A plan may be one point: the car heads for it at the speed that gets it there in time."""
    controller, body = CONTROLLERS["tracker"](to_vehicle_facts(MKZ_2017)), VehicleState(0, 1.0, 0, vx=5.0)
    for _ in range(100):
        ahead = 5.0 * interval_s
        plan = plan_of((body.x + ahead, body.y * (1 - 0.3 * interval_s)), interval_s=interval_s)
        body = step(body, controller.follow(plan, to_ego_state(body), 0), MKZ_2017)
    assert 0.0 < body.y < 0.4  # led back to y = 0 with a time constant of about 3 s
    assert body.vx == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize(
    "points", [[(0.0, 0.0)], [(0.0, 0.0)] * 10, [(-3.0, 0.0)] * 5, [(-3.0, 0.0), (-2.0, 0.0), (-2.0, 0.0)]]
)
def test_tracker_stands_for_plans_here_or_behind(points: list[tuple[float, float]]) -> None:
    controller = CONTROLLERS["tracker"](to_vehicle_facts(MKZ_2017))
    assert controller.follow(plan_of(*points), own(0.0), 0).throttle == 0.0
    assert controller.follow(plan_of(*points), own(6.0), 0).brake > 0.5


@pytest.mark.parametrize("age_ticks", [0, 7])
def test_tracker_looks_at_the_next_seconds_only(age_ticks: int) -> None:
    """A way round a block comes back to where the car is; only its first part counts, however near the last is."""
    round_trip = circle(10.0)
    whole = plan_of(*[round_trip.at(8.0 * 0.2 * (k + 1)) for k in range(80)])
    soon = Plan(whole.points[:18], whole.interval_s)  # 3 s from tick 7 on
    for y in (-0.3, 0.0, 0.3):
        first, second = (
            CONTROLLERS["tracker"](to_vehicle_facts(MKZ_2017)).follow(p, own(8.0, y=y), age_ticks)
            for p in (whole, soon)
        )
        assert first == second


# The paper's controllers.


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


@pytest.mark.parametrize("name", sorted(MEASURED))
def test_paper_controllers_get_round_a_corner(name: str) -> None:
    rows = drive(name, turn(8.0), lambda t: 5.0 * t, 16.0, 1, VehicleState(0, 0, 0, vx=5.0))
    assert np.abs(rows[:, 1]).max() == pytest.approx(MEASURED[name], abs=0.15)
    assert abs(rows[-1, 1]) < 0.25


# Reading plans.


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


@settings(max_examples=100, deadline=None)
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


@settings(max_examples=50, deadline=None)
@given(plans, owns, st.sampled_from(sorted(CONTROLLERS)))
def test_controllers_repeat_themselves(plan: Plan, state: EgoState, name: str) -> None:
    first, second = (CONTROLLERS[name](to_vehicle_facts(MKZ_2017)) for _ in range(2))
    for age in range(6):
        assert first.follow(plan, state, age) == second.follow(plan, state, age)
