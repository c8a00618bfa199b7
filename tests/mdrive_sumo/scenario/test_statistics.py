"""Suite statistics: lengths and heading changes of routes whose shape is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length, compute_suite_statistics


def ego_along(xy: Float, name: str = "0") -> Ego:
    points = tuple((float(x), float(y), 0.0) for x, y in xy)
    return Ego(id=name, start=Pose(x=points[0][0], y=points[0][1], yaw=0.0), lanes=("a_0",), route=points)


def straight(metres: int, yaw: float = 0.0) -> Float:
    s = np.arange(metres + 1.0)
    return np.column_stack((s * math.cos(yaw), s * math.sin(yaw)))


def turn(angle: float, radius: float) -> Float:
    """10 m straight, an arc, 10 m straight, about 1 m a point."""
    n = max(int(abs(angle) * radius), 1)
    hops = np.concatenate((np.zeros(10), np.full(n, angle / n), np.zeros(10)))
    yaw = np.cumsum(hops)
    steps = np.column_stack((np.cos(yaw), np.sin(yaw)))
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


@given(st.integers(1, 60), st.floats(-math.pi, math.pi))
def test_a_straight_route_has_its_length_and_no_heading_change(metres: int, yaw: float) -> None:
    ego = ego_along(straight(metres, yaw))
    assert compute_route_length(ego) == pytest.approx(metres)
    assert compute_heading_change_deg(ego) == pytest.approx(0.0, abs=1e-6)


@given(st.floats(math.radians(20), math.radians(170)), st.floats(6, 30), st.booleans())
def test_a_turn_changes_the_heading_by_its_angle(angle: float, radius: float, left: bool) -> None:
    ego = ego_along(turn(angle if left else -angle, radius))
    assert compute_heading_change_deg(ego) == pytest.approx(math.degrees(angle), rel=1e-6)


def test_a_turn_left_and_one_right_add_up() -> None:
    there = turn(math.radians(40), 10.0)
    ego = ego_along(np.concatenate((there, (2 * there[-1] - there[::-1])[1:])))  # on, mirrored in its last point
    assert compute_heading_change_deg(ego) == pytest.approx(80.0, rel=1e-6)


def test_smoothing_takes_away_zigzag() -> None:
    xy = straight(40)
    xy[1:-1:2, 1] += 0.02  # 2 cm of noise: 78 deg in sum without smoothing
    raw = np.diff(np.arctan2(*np.diff(xy, axis=0).T[::-1]))
    assert np.degrees(np.abs(raw).sum()) > 75
    assert compute_heading_change_deg(ego_along(xy)) < 25


def test_headings_pass_pi_without_a_jump() -> None:
    xy = turn(math.radians(60), 12.0) @ np.array(((-1.0, 0.0), (0.0, -1.0)))
    assert compute_heading_change_deg(ego_along(xy)) == pytest.approx(60.0, rel=1e-6)


def test_means_over_all_cavs_and_over_scenarios() -> None:
    long, short = ego_along(straight(60), "0"), ego_along(straight(30), "1")
    vehicle = BackgroundVehicle(id="v", depart_s=0, edges=("e",))
    one = Scenario(id="one", bucket="B", category="c", network="n", egos=(long,))
    two = Scenario(
        id="two",
        bucket="B",
        category="c",
        network="n",
        egos=(long, short, ego_along(straight(30), "2")),
        background=Background(vehicles=(vehicle, vehicle.model_copy(update={"id": "w"}))),
    )
    found = compute_suite_statistics([one, two])
    assert (found.scenarios, found.cavs, found.mean_cavs) == (2, 4, 2.0)
    assert found.mean_route_m == pytest.approx(45.0)  # over CAVs; over scenarios it would be 50
    assert found.mean_actors == 1.0
