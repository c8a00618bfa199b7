"""Predictions of road users whose intentions are unknown."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from testing.planning import LENGTH, briefing, own, straight, things

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.planning.interaction_prediction import QUEUE_GAP, InteractionPredictor
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion, predict_yielding
from mdrive_sumo.planning.parameters import PLANNER, RIGHT_OF_WAY
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner, StopPoint

RIGHT, LEFT = math.pi / 2, -math.pi / 2
"""Headings of traffic from the right and from the left."""


def expected(
    state: OwnState, *rows: Sequence[float], route: Float | None = None, kind: Kind = Kind.VEHICLE
) -> tuple[list[PredictedMotion], list[StopPoint]]:
    """The first look of a driver on the straight way."""
    return Driver(route).looks(state, things(*rows, kind=kind))


class Driver:
    """Looks five times a second."""

    def __init__(self, route: Float | None = None, seed: int = 1) -> None:
        self.planner = SpaceTimePlanner(briefing(route), 0.0, 8.0)
        self.foresight = InteractionPredictor(briefing(route, seed=seed), 8.0)
        self.tick = 0

    def looks(self, state: OwnState, objects: Objects) -> tuple[list[PredictedMotion], list[StopPoint]]:
        self.planner.track_ego(self.tick, state)
        self.tick += PLANNER.check_ticks
        return self.foresight.predict(state, objects, self.planner)


def test_traffic_from_the_right_goes_first_and_from_the_left_does_not() -> None:
    moving = own(speed=8.0)
    (right,), waits = expected(moving, (20.0, -20.0, RIGHT, 8.0))
    assert len(waits) == 1
    assert right.poses[-1, 1] > 5.0  # and is expected to go on
    (left,), none = expected(moving, (20.0, 20.0, LEFT, 8.0))
    assert none == []
    assert left.stands_at_end
    assert left.poses[-1, 1] == pytest.approx(20.0 - predict_yielding(8.0)[-1])  # he brakes for me


def test_only_vehicles_ahead_in_the_own_direction_get_a_gap_that_grows_with_their_sigma() -> None:
    def find_gap(sigma: float, yaw: float = 0.0, kind: Kind = Kind.VEHICLE) -> float:
        driver, ahead = Driver(), things((12.0, 0.0, yaw, 0.0), kind=kind)
        driver.planner.track_ego(0, own())
        (motion, *_), _ = driver.foresight.predict(own(), ahead, driver.planner, {ahead.ids[0]: sigma})
        return motion.min_gap_m

    assert find_gap(0.0) == PLANNER.min_margin.longitudinal == QUEUE_GAP.exact_m
    assert find_gap(0.0) < find_gap(0.1) < find_gap(0.2) < find_gap(5.0) == QUEUE_GAP.most_m
    assert find_gap(0.2, yaw=RIGHT) == find_gap(0.2, yaw=math.pi) == find_gap(0.2, kind=Kind.STATIC) == 0.0


def test_the_first_to_arrive_goes_first_from_any_side() -> None:
    assert len(expected(own(speed=8.0), (20.0, 12.0, LEFT, 8.0))[1]) == 1
    assert expected(own(speed=8.0), (20.0, -36.0, RIGHT, 8.0))[1] == []


def test_the_stop_point_leaves_room_and_ends_after_the_crossing() -> None:
    _, (wait,) = expected(own(speed=4.0), (20.0, -8.0, RIGHT, 5.0))
    assert 8.0 < wait.s < 20.0 - LENGTH / 2 - 0.9
    assert 2.0 < wait.until_s < 5.0


def test_no_stop_point_if_the_car_cannot_stop() -> None:
    close = (20.0, -6.0, RIGHT, 8.0)
    motions, waits = expected(own(x=12.0, speed=8.0), close)
    assert (len(motions), waits) == (1, [])
    assert len(expected(own(x=12.0, speed=3.0), close)[1]) == 1


def turning_left() -> Float:
    """10 m east, then a quarter circle of 8 m to the left and on."""
    angles = np.linspace(0.0, math.pi / 2, 14)[1:]
    bend = np.column_stack((10.0 + 8.0 * np.sin(angles), 8.0 - 8.0 * np.cos(angles)))
    return np.vstack((straight(10.0), bend, np.column_stack((np.full(20, 18.0), 8.0 + np.arange(1.0, 21.0)))))


def test_a_turning_car_yields_to_oncoming_traffic() -> None:
    oncoming = (28.0, 3.5, math.pi, 5.0)
    motions, waits = expected(own(speed=5.0), oncoming, route=turning_left())
    assert len(motions) == len(waits) == 1
    assert not motions[0].stands_at_end
    assert expected(own(speed=5.0), oncoming) == ([], [])  # straight on it has no conflict


def test_followers_are_ignored() -> None:
    assert expected(own(x=30.0, speed=4.0), (22.0, 0.0, 0.0, 8.0)) == ([], [])
    assert expected(own(x=30.0, speed=4.0), (29.0, 3.0, -0.15, 8.0)) == ([], [])  # beside me, coming into my way
    assert len(expected(own(x=30.0, speed=4.0), (34.0, 3.0, -0.15, 8.0))[0]) == 1  # that one is ahead


def test_a_conflict_at_the_own_position_is_ignored() -> None:
    assert expected(own(x=30.0), (30.0, -8.0, RIGHT, 5.0)) == ([], [])


def test_a_leader_is_predicted_to_brake_along_the_path() -> None:
    (leader,), waits = expected(own(speed=8.0), (15.0, 0.0, 0.0, 6.0))
    assert waits == []
    assert leader.stands_at_end
    assert leader.poses[-1, 0] == pytest.approx(15.0 + predict_yielding(6.0)[-1], abs=0.1)
    (turner,), _ = expected(own(speed=3.0), (10.0, 0.0, 0.0, 8.0), route=turning_left())
    assert turner.poses[-1, 1] > 0.5  # along my bend, not straight on


def test_a_standing_object_on_the_path_stays() -> None:
    (box,), waits = expected(own(speed=8.0), (25.0, 0.5, 1.0, 0.0), kind=Kind.STATIC)
    assert waits == []
    assert box.stands_at_end
    assert np.ptp(box.poses, axis=0) == pytest.approx(0.0)
    assert box.poses[0] == pytest.approx((25.0, 0.5, 1.0))


def test_a_merging_vehicle_may_hesitate() -> None:
    (merging,), waits = expected(own(speed=8.0), (12.0, -3.5, 0.35, 8.0))
    assert waits == []
    assert len(merging.poses) < len(TIMES)
    assert np.all(np.diff(np.asarray(merging.length)) >= 0)
    assert np.asarray(merging.length)[-1] > LENGTH + 3.0


@pytest.mark.parametrize(("side", "waits"), [(1.0, 0), (-1.0, 1)])
def test_of_two_standing_oncoming_cars_the_one_further_west_goes(side: float, waits: int) -> None:
    """The same place twice, the second time turned by half a circle."""
    driver, yaw = Driver(side * straight(60.0)), math.radians(0 if side > 0 else 180)
    driver.planner = SpaceTimePlanner(briefing(side * straight(60.0)), yaw, 8.0)
    askew = things((side * 34.0, side * 3.0, yaw + math.radians(198), 0.0))
    assert len(driver.looks(own(side * 8.0, 0.0, yaw), askew)[1]) == waits


def test_of_two_standing_cars_the_one_from_the_right_goes_first() -> None:
    assert len(expected(own(x=10.0), (20.0, -4.0, RIGHT, 0.0))[1]) == 1
    assert expected(own(x=10.0), (20.0, 4.0, LEFT, 0.0))[1] == []


def test_yielding_has_hysteresis() -> None:
    driver = Driver()
    assert driver.looks(own(speed=8.0), things((20.0, -18.0, RIGHT, 8.0)))[1]
    slightly_later = things((20.0, -25.0, RIGHT, 8.0))
    assert driver.looks(own(speed=8.0), slightly_later)[1]
    assert not Driver().looks(own(speed=8.0), slightly_later)[1]


@pytest.mark.slow
def test_patience_ends_is_drawn_from_the_seed_and_comes_back() -> None:
    waiting = things((20.0, -4.0, RIGHT, 0.0))

    def held(seed: int) -> list[bool]:
        driver = Driver(seed=seed)
        return [bool(driver.looks(own(x=10.0), waiting)[1]) for _ in range(70)]

    step_s = PLANNER.check_ticks * DT
    found = {seed: held(seed) for seed in range(6)}
    patience = {seed: by_time.index(False) * step_s for seed, by_time in found.items()}
    assert all(
        RIGHT_OF_WAY.patience_s[0] <= value <= RIGHT_OF_WAY.patience_s[1] + 2 * step_s for value in patience.values()
    )
    assert len(set(patience.values())) > 1
    assert found[3] == held(3)
    first = found[0].index(False)
    assert found[0][first:].index(True) * step_s == pytest.approx(RIGHT_OF_WAY.impatience_s, abs=2 * step_s)
