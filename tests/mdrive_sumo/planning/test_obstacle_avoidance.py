"""Obstacle avoidance: when a detour is taken, and where the car waits."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from testing.bent_road import CAR, WIDTH, things, told

from mdrive_sumo.contract import Objects, Observation, OwnState
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.planning.obstacle_avoidance import ObstacleAvoidance
from mdrive_sumo.planning.parameters import AVOIDANCE
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner

STANDING_OWN = OwnState(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Driver:
    """A CAV that stands at x = 10 and looks around."""

    def __init__(self, oncoming: int = 1) -> None:
        self.me = told(1e6, oncoming)
        self.planner = SpaceTimePlanner(self.me, 0.0, 8.0)
        self.avoidance = ObstacleAvoidance(self.me)
        self.path = self.planner.path

    def looks(self, seconds: float, objects: Objects, halts: tuple[float, ...] = ()) -> tuple[bool, list[float]]:
        """Whether the path is another one after so long, and where to wait."""
        own, held = STANDING_OWN, []
        for tick in range(0, round(seconds / DT) + 1, 4):
            self.planner.track_ego(tick, own)
            _, holds = self.avoidance.update(Observation(tick, own, objects), objects, self.planner, list(halts))
            held = [barrier.s for barrier in holds]
        return self.planner.path is not self.path, held


OBSTACLE = (35.0, 0.0, 0.0)


def with_oncoming(x: float, speed: float) -> Objects:
    """The obstacle, and a vehicle on the other lane that drives towards the car."""
    both = things(OBSTACLE, (x, WIDTH, speed))
    return replace(both, kind=np.array([Kind.STATIC, Kind.VEHICLE], dtype=np.uint8), yaw=np.array([0.0, math.pi]))


def update_at(driver: Driver, tick: int, objects: Objects) -> list[float]:
    """Where to wait after one more observation."""
    driver.planner.track_ego(tick, STANDING_OWN)
    _, waits = driver.avoidance.update(Observation(tick, STANDING_OWN, objects), objects, driver.planner, [])
    return [wait.s for wait in waits]


def begins_detour(x: float, speed: float) -> bool:
    """Whether the car leaves its path when the obstacle is confirmed and a vehicle comes towards it at x."""
    driver = Driver()
    driver.looks(0.8, things(OBSTACLE))
    update_at(driver, 24, with_oncoming(x, speed))
    return driver.planner.path is not driver.path


def wait_on_detour(x: float, speed: float) -> tuple[list[float], ReferencePath]:
    """Where the car waits on its detour for a vehicle that appears at x, and the detour's path."""
    driver = Driver()
    assert driver.looks(1.4, things(OBSTACLE))[0]
    return update_at(driver, 32, with_oncoming(x, speed)), driver.planner.path


class TestObstacleAvoidance:
    def test_a_static_object_is_passed_once_confirmed(self) -> None:
        assert not Driver().looks(0.6, things((35.0, 0.0, 0.0)))[0]
        assert Driver().looks(1.4, things((35.0, 0.0, 0.0)))[0]

    def test_a_vehicle_is_passed_once_it_is_parked(self) -> None:
        car = things((35.0, 0.0, 0.0), kind=Kind.VEHICLE)
        diverted, held = Driver().looks(9.0, car)
        assert not diverted
        assert held == [pytest.approx(35.0 - 2.25 - 2.45 - 10.0, abs=0.1)]
        assert Driver().looks(10.4, car)[0]

    @pytest.mark.parametrize("kind", [Kind.PEDESTRIAN, Kind.CYCLIST])
    def test_the_car_waits_for_pedestrians_and_cyclists(self, kind: Kind) -> None:
        assert not Driver().looks(15.0, things((35.0, 0.0, 0.0), kind=kind))[0]

    def test_a_vehicle_at_a_red_light_is_not_parked(self) -> None:
        car = things((35.0, 0.0, 0.0), kind=Kind.VEHICLE)
        assert not Driver().looks(15.0, car, halts=(38.0,))[0]
        assert Driver().looks(15.0, things((35.0, 0.0, 0.0)), halts=(38.0,))[0]

    def test_a_vehicle_near_a_moving_one_is_not_parked(self) -> None:
        driver, own = Driver(), STANDING_OWN
        for tick in range(0, 300, 4):
            both = things((35.0, 0.0, 0.0), (30.0 + tick % 12, 5.0, 3.0), kind=Kind.VEHICLE)
            driver.planner.track_ego(tick, own)
            driver.avoidance.update(Observation(tick, own, both), both, driver.planner, [])
        assert driver.planner.path is driver.path

    @pytest.mark.slow
    def test_the_car_waits_for_oncoming_traffic(self) -> None:
        driver, own = Driver(), STANDING_OWN
        diverted_at = None
        for tick in range(0, 400, 4):
            x = 90.0 - 8.0 * tick * DT
            both = things((35.0, 0.0, 0.0), (x, WIDTH, 8.0))
            both = replace(
                both, kind=np.array([Kind.STATIC, Kind.VEHICLE], dtype=np.uint8), yaw=np.array([0.0, math.pi])
            )
            driver.planner.track_ego(tick, own)
            driver.avoidance.update(Observation(tick, own, both), both, driver.planner, [])
            if diverted_at is None and driver.planner.path is not driver.path:
                diverted_at = x
        assert diverted_at is not None
        assert diverted_at < 20.0

    @pytest.mark.slow
    def test_a_detour_begun_goes_on_with_half_the_time_that_it_takes_to_begin_one(self) -> None:
        """Else a car that has turned out would stop, half in the other lane, for what it had just judged to be free."""
        speed, places = 4.0, np.arange(88.0, 106.0, 2.0).tolist()
        begins_from = next(x for x in places if begins_detour(x, speed))
        goes_on_from = next(x for x in places if not wait_on_detour(x, speed)[0])
        assert goes_on_from > places[0]
        assert begins_from - goes_on_from == pytest.approx(speed * AVOIDANCE.time_reserve_s / 2, abs=2.0)

    def test_a_waiting_car_leaves_three_metres_to_what_passes(self) -> None:
        (stop_s,), path = wait_on_detour(40.0, 8.0)
        swept = shapely.box(0.0, WIDTH - 0.9, 100.0, WIDTH + 0.9)
        length, width = CAR.length, CAR.width + 2 * AVOIDANCE.side_gap_m
        poses = zip(*path.xy.T.tolist(), path.body_yaw.tolist(), strict=True)
        boxes = shapely.polygons([box_corners(x, y, yaw, length, width) for x, y, yaw in poses])
        stations = np.arange(len(boxes)) * SPACING_M
        touches_from = stations[shapely.intersects(boxes, swept) & (stations > stop_s)][0]
        assert touches_from - stop_s == pytest.approx(3.0, abs=AVOIDANCE.stride_m)
        assert stop_s > STANDING_OWN.x  # it drives on to there

    @pytest.mark.slow
    def test_standing_vehicles_side_by_side_are_not_passed(self) -> None:
        driver = Driver()
        both = things((35.0, 0.0, 0.0), (35.0, WIDTH, 0.0), kind=Kind.VEHICLE)
        assert not driver.looks(15.0, both)[0]

    @pytest.mark.slow
    def test_the_car_waits_at_a_blocked_road(self) -> None:
        diverted, held = Driver(oncoming=0).looks(3.0, things((35.0, 0.0, 0.0)))
        assert not diverted
        assert held == [pytest.approx(35.0 - 2.25 - 2.45 - 10.0, abs=0.1)]
