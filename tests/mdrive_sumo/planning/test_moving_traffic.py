"""Predicted traffic of roads whose limits count: it brakes, pulls away, and does not slip between two samples."""

import numpy as np
import pytest
from testing.planning import briefing, things
from testing.road_speeds import centre_line

from mdrive_sumo.planning.car_following import FOLLOWING, find_vehicles_ahead, predict_travel
from mdrive_sumo.planning.evasive_profile import build_evasion_problem, find_evasive_profile, find_latest_contact
from mdrive_sumo.planning.parameters import MARGINS
from mdrive_sumo.planning.reference_path import PathState, build_path
from mdrive_sumo.planning.road_direction import build_road_direction
from mdrive_sumo.planning.traffic_prediction import AccelerationEstimator, TrafficView

ROUTE = centre_line()[:301]
TIMES = np.arange(1, 49) * 0.125


def view(speed: float, trends: AccelerationEstimator | None = None) -> TrafficView:
    path, road = build_path(ROUTE, 1.42), build_road_direction(briefing(ROUTE))
    return TrafficView(path, road, 0.0, (4.9, 2.0), speed, 20.0, trends or AccelerationEstimator())


def predict(speeds: list[float], trend: list[float], along: list[list[float]]) -> np.ndarray:
    gaps = np.array(along)
    ahead = find_vehicles_ahead(gaps, gaps > 0, np.full(len(speeds), 5.0))
    return predict_travel(np.array(speeds), np.array(trend), ahead, 20.0, TIMES).distance


def test_a_vehicle_stops_behind_one_that_stands() -> None:
    distance = predict([15.0, 0.0], [0.0, 0.0], [[0.0, 50.0], [-50.0, 0.0]])
    assert distance[-1, 1] == 0.0
    assert 35.0 < distance[-1, 0] <= 50.0 - 5.0 - FOLLOWING.min_gap_m + 1e-6


def test_trends_last_and_dawdling_does_not() -> None:
    alone = np.full((3, 3), -1.0)
    distance = predict([2.0, 12.0, 12.0], [2.0, -4.0, 0.3], alone.tolist())
    assert distance[-1] == pytest.approx([2.0 * 6 + 36.0, 18.0, 72.0], abs=0.1)


def test_accelerations_are_those_of_the_last_observations() -> None:
    trends = AccelerationEstimator()
    for tick in range(20):
        trends.update(things((0.0, 0.0, 0.0, 10.0 - 0.2 * tick)), tick * 0.05)
    seen = things((0.0, 0.0, 0.0, 6.2))
    assert trends.estimate(seen) == pytest.approx([-4.0])
    assert AccelerationEstimator().estimate(seen).tolist() == [0.0]


def test_a_fast_vehicle_is_met_between_two_samples() -> None:
    """It crosses at 30 m/s and is in the own way for less than a sample of the plan."""
    here = view(20.0)
    for late_m in np.arange(0.0, 4.0, 0.25).tolist():
        crossing = things((100.0, -75.0 - late_m, np.pi / 2, 30.0))
        times = np.arange(1, 13) * 0.5
        cells = np.round((50.0 + 20.0 * times) / 0.25).astype(np.int64)
        assert here.find_met(cells, crossing, times, MARGINS.contact).any()


def test_a_fast_car_looks_further_ahead_than_a_slow_one() -> None:
    """A vehicle that crosses in 6.5 s: who drives 20 m/s has to know it now."""
    crossing = things((150.0, -130.0, np.pi / 2, 20.0))
    cells, times = np.arange(560, 640), np.arange(1, 72) * 0.125
    assert view(20.0).find_blocked_cells(cells, crossing, times, MARGINS.plan).any()
    assert not view(5.0).find_blocked_cells(cells, crossing, times, MARGINS.plan).any()


def test_a_crossing_vehicle_that_brakes_hard_is_about_to_stop() -> None:
    trends = AccelerationEstimator()
    trends.update(things((150.0, -60.0, np.pi / 2, 16.0)), 0.0)
    braking = things((150.0, -55.0, np.pi / 2, 14.0))
    trends.update(braking, 0.3)
    cells = np.arange(560, 640)
    assert view(20.0).find_blocked_cells(cells, braking, TIMES, MARGINS.plan).any()
    assert not view(20.0, trends).find_blocked_cells(cells, braking, TIMES, MARGINS.plan).any()


def test_a_slow_car_leaves_the_way_of_a_fast_one_instead_of_stopping_in_it() -> None:
    def find_met(stations: np.ndarray, times: np.ndarray) -> np.ndarray:
        return (times > 2.0) & (times < 4.0) & (np.abs(stations - 10.0) < 6.0)

    profile = find_latest_contact(np.full(400, 15.0), PathState(8.0, 4.0), find_met)
    assert profile.speed.min() >= 4.0
    assert not find_met(profile.s[1:], np.arange(1, len(profile.s)) * profile.step_s).any()


def test_a_fast_car_changes_its_speed_every_half_second_to_evade() -> None:
    """A vehicle fills its way from 1 s to 2 s on, 33 m ahead: it brakes for a second, and passes behind."""
    path, speeds = build_path(ROUTE, 1.42), np.full(2000, 22.0)
    problem = build_evasion_problem(path, speeds, PathState(10.0, 20.0), 22.0)
    blocked = np.zeros_like(problem.blocked)
    blocked[8:16, 130:170] = True
    profile = find_evasive_profile(problem, lambda _: blocked.copy())
    assert profile is not None
    assert not profile.reaches_goal
    assert profile.step_s == 0.5
    assert profile.speed.min() > 5.0
    assert find_evasive_profile(problem, lambda _: np.ones_like(problem.blocked)) is None


def test_a_present_profile_without_contact_is_kept() -> None:
    never = find_latest_contact(np.full(400, 15.0), PathState(0.0, 8.0), lambda s, _: s > 1e3)
    kept = find_latest_contact(np.full(400, 15.0), PathState(0.0, 8.0), lambda s, _: s > 1e3, (never, 1.0))
    assert kept.speed[0] == pytest.approx(never.speed[4], abs=0.6)


def test_a_review_does_not_look_as_far_as_a_plan_for_crossing_traffic() -> None:
    crossing = things((150.0, -17.0, np.pi / 2, 4.0))
    here, cells = view(2.0), np.full(len(TIMES), 600)
    assert here.find_blocked_cells(cells[:1], crossing, TIMES, MARGINS.plan).any()
    assert not here.find_met(cells, crossing, TIMES, MARGINS.plan).any()
