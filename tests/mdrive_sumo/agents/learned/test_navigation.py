"""Navigation: places on the route, frames, commands, distances, and the vector that a network gets."""

import math

import numpy as np
import pytest
from testing.learned_samples import make_briefing

from mdrive_sumo.agents.learned.ego_frame import convert_to_ego, convert_to_world
from mdrive_sumo.agents.learned.navigation import RouteNavigator
from mdrive_sumo.agents.learned.system_spec import COMMANDS, NAVIGATION_SIZE, ROUTE_POINTS, ROUTE_STEP_M
from mdrive_sumo.contract import OwnState


def own(x: float, y: float, yaw: float = 0.0, speed: float = 5.0) -> OwnState:
    return OwnState(x, y, yaw, speed, 0.0, 0.0, 0.0)


def make_left_turn() -> tuple[np.ndarray, np.ndarray]:
    """40 m east, a bend of radius 10 m to the north, 40 m north."""
    yaw = np.concatenate((np.zeros(40), np.linspace(0, math.pi / 2, 17), np.full(40, math.pi / 2)))
    middle = (yaw[1:] + yaw[:-1]) / 2
    steps = np.column_stack((np.cos(middle), np.sin(middle)))
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0))), yaw


def test_points_go_to_the_ego_frame_and_back() -> None:
    state = own(10.0, 20.0, math.pi / 2)
    ahead_and_left = np.array(((10.0, 25.0), (7.0, 20.0)))
    found = convert_to_ego(ahead_and_left, state)
    assert found == pytest.approx(np.array(((5.0, 0.0), (0.0, 3.0))), abs=1e-9)
    assert convert_to_world(found, state) == pytest.approx(ahead_and_left)


def test_a_car_beside_a_straight_route() -> None:
    briefing = make_briefing(np.column_stack((np.arange(101.0), np.zeros(101))), lane_width=3.5, limit=6.0)
    found = RouteNavigator(briefing).locate(own(0.5, 2.0))
    assert found.station_m == 0.5 and found.goal_m == 99.5 and found.command == COMMANDS.index("follow")
    assert found.target_points == pytest.approx(np.array(((10.0, -2.0), (25.0, -2.0))))
    assert found.route[:, 0] == pytest.approx(ROUTE_STEP_M * np.arange(ROUTE_POINTS))
    assert found.route[:, 1:] == pytest.approx(np.tile((-2.0, 1.75, 6.0), (ROUTE_POINTS, 1)))


@pytest.mark.parametrize(("desired", "expected"), [(8.0, 8.0), (20.0, 13.0), (None, 13.0)])
def test_the_speed_is_that_of_the_scenario_where_the_road_allows_it(desired: float | None, expected: float) -> None:
    route = np.column_stack((np.arange(101.0), np.zeros(101)))
    briefing = make_briefing(route, limit=13.0, desired_speed=desired)
    assert set(RouteNavigator(briefing).locate(own(0, 0)).route[:, 3]) == {expected}


def test_the_station_never_decreases_and_a_crossing_route_does_not_confuse_it() -> None:
    east, loop = np.arange(0.0, 40.0), np.arange(1, 63) / 10.0
    circle = np.column_stack((40 + 10 * np.sin(loop), 10 - 10 * np.cos(loop)))
    route = np.concatenate(
        (np.column_stack((east, 0 * east)), circle, np.column_stack((np.arange(41.0, 80), [0] * 39)))
    )
    navigator = RouteNavigator(make_briefing(route))
    stations = [navigator.locate(own(x, y)).station_m for x, y in route.tolist()]
    assert np.diff(stations).min() >= 0 and np.abs(np.array(stations) - np.arange(len(route))).max() < 1.5
    assert navigator.locate(own(*route[-6].tolist())).station_m == stations[-1]


def test_a_turn_is_announced_20_m_before_it_and_until_it_ends() -> None:
    route, yaw = make_left_turn()
    navigator = RouteNavigator(make_briefing(route, yaw))
    commands = [navigator.locate(own(*xy, yaw=a)).command for xy, a in zip(route.tolist(), yaw.tolist(), strict=True)]
    left = np.flatnonzero(np.array(commands) == COMMANDS.index("left"))
    assert left[0] == 20 and left[-1] == pytest.approx(56, abs=1) and len(left) == left[-1] - left[0] + 1


def test_distances_to_the_goal_and_to_the_next_line() -> None:
    route = np.column_stack((np.arange(101.0), np.zeros(101)))
    navigator = RouteNavigator(make_briefing(route, stops=(70.0, 30.0)))
    found = [navigator.locate(own(x, 0.0)) for x in (4.0, 12.0, 24.0, 31.0, 40.0, 54.0, 65.0, 71.0, 85.0, 99.0, 105.0)]
    assert [row.stop_m for row in found] == [26.0, 18.0, 6.0, 39.0, 30.0, 16.0, 5.0, 50.0, 50.0, 50.0, 50.0]
    assert [row.goal_m for row in found][-2:] == [1.0, 0.0]
    assert found[-2].route[1:, :2] == pytest.approx(np.tile((1.0, 0.0), (ROUTE_POINTS - 1, 1)))
    assert found[-2].target_points.tolist() == [[1.0, 0.0], [1.0, 0.0]]


def test_the_vector() -> None:
    route = np.column_stack((np.arange(101.0), np.zeros(101)))
    vector = RouteNavigator(make_briefing(route, stops=(20.0,))).locate(own(10.0, 0.0)).build_vector(5.0)
    assert vector.dtype == np.float32 and vector.shape == (NAVIGATION_SIZE,)
    assert vector == pytest.approx((0.5, 1, 0, 0, 0, 0, 0.5, 0, 1.25, 0, 1.0, 0.2))
