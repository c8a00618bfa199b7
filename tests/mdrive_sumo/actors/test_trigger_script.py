"""Actions of triggers: start_motion, hard_brake, lane_change, and pacing before them (protocol 3.4)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.actors_world import Egos, Film, actor, no_egos, two_lanes

from mdrive_sumo.actors.trigger_script import compute_initial_speed, compute_paced_speed
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.scenario.scripted_actor import (
    Action,
    Actor,
    DistanceTrigger,
    HardBrake,
    LaneChange,
    LaneMotion,
    PositionTrigger,
    TimeTrigger,
)

NEAR = DistanceTrigger(vehicle="0", distance_m=10.0)
AWAY = EgoState(1000.0, 1000.0, 0.0, 0.0)


def coming(speed: float, x: float = -100.0, y: float = 0.0) -> Egos:
    """CAV 0 comes along y at a steady speed."""
    return lambda tick: {"0": EgoState(x + speed * tick / 20, y, 0.0, speed)}


def lane_follower(action: Action, y: float = 0.0, lane: str = "r_0") -> Actor:
    motion = LaneMotion(lanes=(lane,), speed=8, start_speed=8)
    car = actor("v", "vehicle", at=(20, y))
    return car.model_copy(update={"motion": motion, "trigger": TimeTrigger(at_s=1.0), "action": action})


def test_start_motion_waits_for_the_cav_centre_to_centre() -> None:
    walker = actor("p", "pedestrian", points=[(0, -6), (0, 6)], speed=1.5, trigger=NEAR)
    x, y, _, v = Film(walker, egos=coming(10.0), seconds=16).of("p").T
    first = int(np.argmax(v > 0))
    cav = -100 + 10 * (first - 1) / 20
    assert math.hypot(cav, -6.0) <= 10.0 < math.hypot(cav - 0.5, -6.0)
    assert not v[:first].any()
    assert (x == 0).all()
    assert y[-1] > 0


def test_start_motion_goes_on_when_the_cav_is_gone_again() -> None:
    walker = actor("p", "pedestrian", points=[(0, -6), (0, 6)], speed=1.5, trigger=NEAR)
    v = Film(walker, egos=lambda t: {"0": EgoState(0.0, 0.0, 0.0, 0.0) if t == 40 else AWAY}, seconds=5).of("p")[:, 3]
    assert not v[:41].any()
    assert v[-1] == 1.5


@pytest.mark.parametrize(
    ("trigger", "tick"),
    [(TimeTrigger(at_s=2.0), 40), (PositionTrigger(vehicle="0", x=-50, y=0.5, radius_m=3.0), 95)],
)
def test_other_triggers(trigger: TimeTrigger | PositionTrigger, tick: int) -> None:
    walker = actor("p", "pedestrian", points=[(0, -6), (0, 6)], speed=1.5, trigger=trigger)
    v = Film(walker, egos=coming(10.0), seconds=10).of("p")[:, 3]
    assert int(np.argmax(v > 0)) in (tick, tick + 1)


def test_a_replay_that_waits_for_its_trigger_stands_at_its_first_pose() -> None:
    poses = [(0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), (2.0, 2.0, 0.0, 0.0)]
    x = Film(actor("r", "pedestrian", poses=poses, trigger=TimeTrigger(at_s=3.0)), seconds=6).of("r")[:, 0]
    assert not x[:61].any()
    assert 0.5 < x[81] < 1.0  # it walks off as walkers do
    assert np.isnan(x[-1])


def test_a_cav_that_has_ended_triggers_nothing() -> None:
    walker = actor("p", "pedestrian", points=[(0, -6), (0, 6)], speed=1.5, trigger=NEAR)
    ghost = Film(walker, egos=lambda tick: {"1": EgoState(0.0, 0.0, 0.0, 0.0)}, seconds=5).of("p")
    assert not ghost[:, 3].any()


@pytest.mark.slow
def test_hard_brake_stops_with_all_it_has_holds_and_resumes() -> None:
    car = actor(
        "v", "vehicle", points=[(0, 0), (300, 0)], speed=8, start_speed=8,
        trigger=TimeTrigger(at_s=1.0), action=HardBrake(hold_s=2.0, resume_speed=5.0),
    )  # fmt: skip
    v = Film(car, egos=no_egos, seconds=20).of("v")[:, 3]
    assert v[59] == 8.0  # triggered after 1 s, but it has to have driven for 3 s
    braking = int(np.argmax(v < 8.0))
    assert braking in (60, 61)
    assert np.diff(v).min() * 20 == pytest.approx(-8.0)
    still = np.flatnonzero(v == 0.0)
    assert still[0] - braking == pytest.approx(20, abs=1)
    assert len(still) == pytest.approx(40, abs=2)
    assert v[-1] == 5.0
    assert v[still[-1] :].max() == 5.0


def test_hard_brake_waits_for_the_metres_too() -> None:
    car = actor(
        "v", "vehicle", points=[(0, 0), (300, 0)], speed=8, start_speed=8,
        trigger=TimeTrigger(at_s=0.0), action=HardBrake(least_driven_m=60.0),
    )  # fmt: skip
    x, _, _, v = Film(car, seconds=15).of("v").T
    assert x[int(np.argmax(v < 8.0))] == pytest.approx(60.0, abs=0.9)


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "lane", "y"), [("left", "r_0", 3.5), ("right", "r_1", 0.0)])
def test_lane_change_keeps_for_5_m_goes_over_in_25_m_and_then_on_in_parallel(
    direction: str, lane: str, y: float
) -> None:
    action = LaneChange(direction=direction, least_driven_s=2.0)
    at = 3.5 - y
    film = Film(lane_follower(action, at, lane), roads=two_lanes(), seconds=15).of("v")
    fires = film[40, 0]
    before, on, after = (film[int(np.argmax(film[:, 0] > fires + way)), 1] for way in (5.0, 17.5, 31.0))
    assert before == pytest.approx(at, abs=0.01)
    assert on == pytest.approx(1.75, abs=0.2)
    assert after == pytest.approx(y, abs=0.01)
    assert film[-1, 1] == pytest.approx(y, abs=1e-6)
    assert np.abs(np.diff(film[:, 2])).max() < math.radians(2)
    assert film[-1, 3] == 8.0


@pytest.mark.slow
@pytest.mark.parametrize(("cav_y", "y"), [(-3.5, 0.0), (7.0, 3.5), (0.0, 3.5)])
def test_without_a_direction_it_goes_toward_the_target_vehicle_else_left(cav_y: float, y: float) -> None:
    start = (1.75 if cav_y == 0.0 else 3.5, "r_1") if y == 0.0 else (0.0, "r_0")
    car = lane_follower(LaneChange(target_vehicle="0", least_driven_s=1.0), *start)
    film = Film(car, roads=two_lanes(), seconds=12, egos=lambda tick: {"0": EgoState(0.0, cav_y, 0.0, 0.0)})
    assert film.of("v")[-1, 1] == pytest.approx(y, abs=0.01)


@pytest.mark.slow
def test_where_there_is_no_lane_it_stays_on_its_own_but_a_path_goes_over_by_a_lane() -> None:
    action = LaneChange(direction="right", least_driven_s=1.0)
    assert not Film(lane_follower(action), roads=two_lanes(), seconds=12).of("v")[:, 1].any()
    car = actor(
        "v", "vehicle", points=[(20, 0), (300, 0)], speed=8, start_speed=8,
        trigger=TimeTrigger(at_s=1.0), action=action,
    )  # fmt: skip
    assert Film(car, roads=two_lanes(), seconds=12).of("v")[-1, 1] == pytest.approx(-3.5, abs=0.01)


def test_pacing_is_the_formula_of_the_protocol() -> None:
    assert compute_paced_speed(10.0, 38.0, 8.0, target=12.0) == pytest.approx(7.0)  # 10 - 30/10
    assert compute_paced_speed(2.0, 38.0, 8.0, target=12.0) == pytest.approx(1.0)  # at least 1 m/s, far away
    assert compute_paced_speed(4.0, 20.5, 8.0, target=12.0) == pytest.approx(2.75)
    assert compute_paced_speed(2.1, 20.5, 8.0, target=12.0) == pytest.approx(2.0)  # at least 1 + 2 (1 - 12.5/25)
    assert compute_paced_speed(10.0, 9.0, 8.0, target=5.0) == 5.0  # at most its target
    assert compute_paced_speed(10.0, 8.5, 8.0, target=12.0) == pytest.approx(9.8)  # at most 0.98 of the CAV's
    assert compute_paced_speed(0.05, 20.0, 8.0, target=12.0) == 0.0


@given(ego=st.floats(0, 30), distance=st.floats(0, 300), trigger=st.floats(1, 50), target=st.floats(0, 30))
def test_paced_speed_never_exceeds_target_or_cav(ego: float, distance: float, trigger: float, target: float) -> None:
    assert 0.0 <= compute_paced_speed(ego, distance, trigger, target) <= min(target, max(0.98 * ego, 0.0)) + 1e-12


def test_the_initial_speed_falls_from_the_target_to_2_with_the_distance() -> None:
    assert compute_initial_speed(12.0, 8.0, 10.0) == 10.0
    assert compute_initial_speed(36.0, 8.0, 10.0) == pytest.approx(6.0)  # half-way between 12 and 60
    assert compute_initial_speed(100.0, 8.0, 10.0) == 2.0
    assert compute_initial_speed(54.0 + 15.0, 50.0, 10.0) == pytest.approx(6.0)  # between 54 and 84


def test_before_its_trigger_it_paces_the_cav_and_without_pacing_it_does_not() -> None:
    def car(pacing: bool) -> Actor:
        return actor(
            "v", "vehicle", points=[(0, 3.5), (300, 3.5)], speed=10, start_speed=10,
            trigger=NEAR, action=HardBrake(pacing=pacing),
        )  # fmt: skip

    paced = Film(car(True), egos=coming(6.0, x=-40), seconds=5).of("v")
    gap = math.hypot(paced[-2, 0] - (-40 + 6 * 99 / 20), 3.5) - 10.0
    assert paced[-1, 3] == pytest.approx(compute_paced_speed(6.0, gap + 10.0, 10.0, 10.0), abs=0.05)
    assert paced[-1, 3] < 6.0
    assert Film(car(False), egos=coming(6.0, x=-40), seconds=5).of("v")[-1, 3] == 10.0
