"""The tracker in closed loops with the plant, and with odd plans."""

import numpy as np
import pytest
from testing.control_loop import Profile, circle, drive, own, plan_of, straight_plan, turn

from mdrive_sumo.contract import Plan
from mdrive_sumo.core.geometry import Polyline, build_polyline
from mdrive_sumo.core.state import DT
from mdrive_sumo.vehicle.control import CONTROLLERS
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleState, step, to_ego_state, to_vehicle_facts


def stopping(speed: float, deceleration: float, after_s: float) -> Profile:
    def wanted(t: float) -> float:
        braked = min(max(0.0, t - after_s), speed / deceleration)
        return speed * (min(t, after_s) + braked) - deceleration * braked**2 / 2

    return wanted


STRAIGHT = build_polyline(((0.0, 0.0), (500.0, 0.0)))


@pytest.mark.slow
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
