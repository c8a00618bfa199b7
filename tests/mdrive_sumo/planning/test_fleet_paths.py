"""Predictions of other road users on the paths of all CAVs, and the order of planning."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mdrive_sumo.contract import Objects, OwnState, Plan
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.fleet_paths import (
    FleetPaths,
    find_cells_blocked_by_objects,
    predict_stations,
    predict_stations_at,
)
from mdrive_sumo.planning.parameters import MARGINS
from mdrive_sumo.planning.planning_order import find_planning_order
from mdrive_sumo.planning.reference_path import PathState, ReferencePath, build_path
from mdrive_sumo.planning.speed_profile import (
    SpeedProfileProblem,
    build_free_road_problem,
)

REAR = 1.42
STRAIGHT = np.column_stack((np.arange(61.0), np.zeros(61)))
SIZE = (4.9, 2.0)


def straight_path() -> ReferencePath:
    return build_path(STRAIGHT, REAR)


def free_task(path: ReferencePath, speed: float = 0.0, until_s: float = 30.0) -> SpeedProfileProblem:
    return build_free_road_problem(path, np.full(len(path.xy), 9.0), PathState(0.0, speed), 0.0, until_s)


def cars(*rows: tuple[float, float, float, float]) -> Objects:
    """Cars of x, y [m], yaw [rad], speed [m/s]."""
    x, y, yaw, speed = np.array(rows).reshape(-1, 4).T
    names = tuple(f"b{i}" for i in range(len(rows)))
    kind = np.full(len(rows), Kind.VEHICLE, dtype=np.uint8)
    return Objects(names, kind, x, y, yaw, speed, np.full(len(rows), 4.5), np.full(len(rows), 1.8))


def test_plans_are_read_from_now_on_and_extended() -> None:
    path = straight_path()
    state = OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    plan = Plan(np.array([(2.0, 0.0), (4.0, 0.0), (7.0, 0.0)]), 0.5)
    times = np.array([0.45, 0.95, 1.45, 2.45])
    assert predict_stations(path, state, plan, times, 0.05) == pytest.approx([2.0, 4.0, 7.0, 13.0])
    moving = replace(state, x=3.0, speed=4.0)
    assert predict_stations(path, moving, None, times, 0.05) == pytest.approx(3.0 + 4.0 * times)


def test_plans_on_long_paths_are_read_as_on_short_ones() -> None:
    along = np.arange(0.0, 300.0)
    path = build_path(np.column_stack((along, 20.0 * np.cos(along / 40.0))), REAR)
    state = OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    driven = np.concatenate((np.full(9, 4.0), np.arange(6.0, 180.0, 3.7), np.full(5, 180.0)))
    plan = Plan(path.get_points(driven), 0.25)
    times = [np.arange(1, 40) * 0.125, np.arange(1, 200) * 0.125]
    expected = [predict_stations(path, state, plan, one, 0.05) for one in times]
    assert [one.tolist() for one in predict_stations_at(path, state, plan, times, 0.05)] == [
        one.tolist() for one in expected
    ]
    (extended,) = predict_stations_at(path, replace(state, speed=4.0), None, times[:1], 0.05)
    assert np.diff(extended) == pytest.approx(0.5)


def test_background_cars_block_where_they_will_be() -> None:
    path = straight_path()
    cells, times = np.arange(240), np.array([1.0, 2.0, 30.0])
    seen = cars((30.0, -8.0, math.pi / 2, 4.0), (50.0, 0.0, 0.0, 0.0))
    blocked = find_cells_blocked_by_objects(path, cells, seen, times, SIZE, MARGINS.plan)
    assert not blocked[0, : 40 * 4].any()  # at y = -4 it is still beside
    assert blocked[1, 30 * 4]  # at y = 0
    assert not blocked[2, 30 * 4]  # long gone
    assert blocked[:, 50 * 4].all()  # stands


def test_a_car_that_blocks_another_plans_first() -> None:
    behind = STRAIGHT - (6.0, 0.0)
    fleet = FleetPaths({"0": build_path(behind, REAR), "1": straight_path()}, SIZE)
    assert fleet.find_blocking_starts("0") == {"1"}
    assert fleet.find_blocking_starts("1") == frozenset()
    tasks = {name: free_task(path) for name, path in fleet.path_by_ego.items()}
    assert find_planning_order(fleet, tasks) == ("1", "0")
