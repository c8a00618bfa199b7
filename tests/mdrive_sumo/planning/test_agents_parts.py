"""What the built-in agents are made of: paths, footprints, speed profiles in space and time, orders."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st
from testing.agents_driving import crossing_route

from mdrive_sumo.contract import Objects, OwnState, Plan
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.fleet_paths import FleetPaths, find_cells_blocked_by_objects, predict_stations
from mdrive_sumo.planning.parameters import MARGINS, PROFILE
from mdrive_sumo.planning.path_follower import FOLLOWER, PathFollower
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, compute_path_overlaps
from mdrive_sumo.planning.planning_order import find_planning_order
from mdrive_sumo.planning.reference_path import PATH, SPACING_M, ReferencePath, build_path, compute_curve_speeds
from mdrive_sumo.planning.speed_profile import (
    SAMPLE_S,
    STEP_S,
    SpeedProfile,
    SpeedProfileProblem,
    build_braking_profile,
    build_free_road_problem,
    find_fastest_profile,
)

REAR = 1.42
STRAIGHT = np.column_stack((np.arange(61.0), np.zeros(61)))
SIZE = (4.9, 2.0)


def circle(radius: float, angle: float) -> Float:
    """Route (N, 2) with a hop of 1 m, counter-clockwise from (radius, 0)."""
    turns = np.arange(0.0, angle, 1.0 / radius)
    return radius * np.column_stack((np.cos(turns), np.sin(turns)))


def straight_path() -> ReferencePath:
    return build_path(STRAIGHT, REAR)


def free_task(path: ReferencePath, speed: float = 0.0, until_s: float = 30.0) -> SpeedProfileProblem:
    return build_free_road_problem(path, np.full(len(path.xy), 9.0), (0.0, speed), 0.0, until_s)


def cars(*rows: tuple[float, float, float, float]) -> Objects:
    """Cars of x, y [m], yaw [rad], speed [m/s]."""
    table = np.array(rows).reshape(-1, 4)
    names = tuple(f"b{i}" for i in range(len(table)))
    kind = np.full(len(table), Kind.VEHICLE, dtype=np.uint8)
    return Objects(names, kind, *table.T, np.full(len(table), 4.5), np.full(len(table), 1.8))


# Paths


@given(radius=st.floats(6.0, 60.0))
def test_a_path_on_a_circle_has_its_curvature_and_stays_near(radius: float) -> None:
    path = build_path(circle(radius, 2.5), REAR)
    inner = slice(round(5 / SPACING_M), round(path.goal_s / SPACING_M) - round(5 / SPACING_M))
    assert path.curvature[inner] == pytest.approx(1 / radius, rel=0.05)
    cut = radius - np.hypot(*path.xy[inner].T)
    assert cut.max() < 2.0**2 / (6 * radius) + 1 / (8 * radius) + 0.02  # moving average, and chords of the 1 m route
    body = math.asin(REAR / radius)  # steady turn: the rear axle runs on the tangent of its own circle
    assert path.yaw[inner][-1] - path.body_yaw[inner][-1] == pytest.approx(body, rel=0.1)


def test_a_path_goes_on_beyond_the_goal() -> None:
    path = straight_path()
    assert path.goal_s == pytest.approx(60.0, abs=0.01)
    assert path.length > path.goal_s + 9.0
    assert path.get_points(np.array([65.0]))[0] == pytest.approx((65.0, 0.0), abs=0.01)


@given(x=st.floats(-3.0, 69.0), y=st.floats(-2.0, 2.0), near=st.floats(-4.0, 4.0))
def test_projection_on_a_straight_path(x: float, y: float, near: float) -> None:
    assert straight_path().project(x, y, x + near) == pytest.approx(max(x, 0.0), abs=1e-6)


def test_a_path_that_leaves_at_an_angle_begins_straight() -> None:
    askew = STRAIGHT @ np.array(((math.cos(0.4), math.sin(0.4)), (-math.sin(0.4), math.cos(0.4))))
    path = build_path(askew, REAR, 0.0)
    assert path.yaw[0] == pytest.approx(0.0, abs=0.05)
    assert path.body_yaw[0] == pytest.approx(0.0)
    far = path.xy[round((PATH.join_m + 4) / SPACING_M) :]
    assert np.abs(far[:, 1] * math.cos(0.4) - far[:, 0] * math.sin(0.4)).max() < 0.02


def test_curve_speeds_keep_within_both_limits() -> None:
    path = build_path(crossing_route("right", 0), REAR)
    speeds = compute_curve_speeds(path, 8.0, 3.0, 2.0)
    assert speeds.max() == 8.0
    assert (speeds**2 * np.abs(path.curvature)).max() <= 3.0 + 1e-9
    assert (-np.diff(speeds**2) / 2 / SPACING_M).max() <= 2.0 + 1e-9


def test_a_reference_never_runs_away_from_a_car_that_is_held() -> None:
    reference = PathFollower(straight_path())
    for _ in range(200):
        reference.update(10.0, 0.0, 0.0)
        reference.advance(2.0, np.full(400, 8.0), 0.05)
    assert reference.s == pytest.approx(10.0 + FOLLOWER.lead_m, abs=0.2)


# Footprints


@given(st.data())
def test_overlaps_agree_with_shapely(data: st.DataObject) -> None:
    rows = st.lists(st.tuples(*[st.integers(-60, 60)] * 2, st.floats(-3.1, 3.1)), min_size=1, max_size=4)
    sides = [np.array(data.draw(rows)) for _ in range(2)]
    mine, others = (_corners(side) for side in sides)
    expected = [[_shared_area(a, b) for b in others] for a in mine]
    found = compute_overlaps(mine, others)
    for i, row in enumerate(expected):
        for j, area in enumerate(row):
            if not 0.0 < area < 1e-6:  # a touch is decided by rounding
                assert found[i, j] == (area > 0.0)


def _corners(rows: Float) -> Float:
    boxes = [
        shapely.affinity.rotate(
            shapely.box(x / 10 - 2.45, y / 10 - 1, x / 10 + 2.45, y / 10 + 1), yaw, use_radians=True
        )
        for x, y, yaw in rows
    ]
    return np.array([shapely.get_coordinates(box)[:4] for box in boxes])


def _shared_area(a: Float, b: Float) -> float:
    return float(shapely.Polygon(a).intersection(shapely.Polygon(b)).area)


def test_paths_on_one_line_overlap_within_a_car_length() -> None:
    path = straight_path()
    met = compute_path_overlaps(path, path, SIZE, MARGINS.contact)
    apart = np.abs(np.subtract.outer(np.arange(len(met)), np.arange(len(met)))) * SPACING_M
    assert np.array_equal(met, apart < 4.9 + MARGINS.contact.longitudinal)


# Profiles


@given(speed=st.floats(0.0, 9.0), wall=st.integers(0, 200), opens=st.floats(0.0, 20.0))
def test_profiles_keep_limits_and_never_enter_what_is_blocked(speed: float, wall: int, opens: float) -> None:
    task = free_task(straight_path(), speed)
    blocked = np.zeros_like(task.blocked)
    blocked[task.times < opens, wall : wall + 20] = True
    profile = find_fastest_profile(replace(task, blocked=blocked))
    if profile is None:
        assert wall * SPACING_M < speed**2 / 8 + 5  # only what lies too near to stop before is hopeless
        return
    change = np.diff(profile.speed) / STEP_S
    assert np.all((change >= -4.0) & (change <= 2.0) & (profile.speed[1:] <= 9.0) & (profile.speed[1:] >= 0.0))
    assert np.diff(profile.s) == pytest.approx((profile.speed[1:] + profile.speed[:-1]) / 2 * STEP_S)
    times = np.arange(SAMPLE_S, (len(profile.s) - 1) * STEP_S, SAMPLE_S)
    row = np.round(times / SAMPLE_S).astype(int) - 1
    inside = (profile.get_stations(times) / SPACING_M > wall + 1) & (
        profile.get_stations(times) / SPACING_M < wall + 18
    )
    assert not (inside & (times < opens))[row < len(blocked)].any()
    assert profile.reaches_goal


def test_a_free_road_is_driven_in_the_least_time() -> None:
    profile = find_fastest_profile(free_task(straight_path()))
    assert profile is not None
    # 2 m/s2 up to 9 m/s takes 4.5 s and 20.25 m; the other 40.75 m take 4.53 s.
    assert (len(profile.s) - 1) * STEP_S == pytest.approx(4.5 + (60 + PROFILE.beyond_goal_m - 20.25) / 9, abs=STEP_S)


def test_no_way_out_is_no_profile() -> None:
    task = free_task(straight_path(), 8.0)
    assert find_fastest_profile(replace(task, blocked=np.ones_like(task.blocked))) is None
    halt = build_braking_profile(task)
    assert list(halt.speed) == [8.0, 6.0, 4.0, 2.0, 0.0]
    assert halt.s[-1] == pytest.approx(8.0)


def test_a_stop_ends_standing_in_its_window_and_the_rest_goes_on() -> None:
    task = free_task(straight_path(), 5.0)
    part = find_fastest_profile(task.require_stop(30.0, 31.5))
    assert part is not None
    assert part.speed[-1] == 0.0
    assert 30.0 <= part.s[-1] <= 31.5
    part = part.extend_standstill(3)
    rest = find_fastest_profile(task.build_remainder(part))
    assert rest is not None
    whole = part.append(rest)
    assert whole.reaches_goal
    assert np.diff(whole.s).min() >= 0.0
    assert len(whole.s) == len(part.s) + len(rest.s) - 1


def test_nobody_stands_for_thirty_seconds() -> None:
    task = free_task(straight_path(), until_s=60.0)
    blocked = np.zeros_like(task.blocked)
    blocked[task.times < 40.0, 30:] = True
    profile = find_fastest_profile(replace(task, blocked=blocked))
    assert profile is not None
    standing = np.convolve(profile.speed == 0.0, np.ones(int(29 / STEP_S)), mode="valid")
    assert standing.max() < int(29 / STEP_S)
    assert PROFILE.idle_period_s < 30.0


def test_bumper_to_bumper_is_forgiven_only_until_the_margin_is_whole() -> None:
    task = free_task(straight_path())
    violated = np.zeros_like(task.blocked)
    violated[:40, :3] = True
    violated[60:, 0] = True
    eased = task.add_traffic(lambda margin: np.zeros_like(violated) if margin == MARGINS.contact else violated.copy())
    assert not eased.blocked[:40].any()
    assert eased.blocked[60:, 0].all()


# The others


def test_plans_are_read_as_of_now_and_prolonged() -> None:
    path = straight_path()
    state = OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    plan = Plan(np.array([(2.0, 0.0), (4.0, 0.0), (7.0, 0.0)]), 0.5)
    times = np.array([0.45, 0.95, 1.45, 2.45])
    assert predict_stations(path, state, plan, times, 0.05) == pytest.approx([2.0, 4.0, 7.0, 13.0])
    moving = replace(state, x=3.0, speed=4.0)
    assert predict_stations(path, moving, None, times, 0.05) == pytest.approx(3.0 + 4.0 * times)


def test_background_cars_block_where_they_will_be() -> None:
    path = straight_path()
    cells, times = np.arange(240), np.array([1.0, 2.0, 30.0])
    seen = cars((30.0, -8.0, math.pi / 2, 4.0), (50.0, 0.0, 0.0, 0.0))
    blocked = find_cells_blocked_by_objects(path, cells, seen, times, SIZE, MARGINS.plan)
    assert not blocked[0, : 40 * 4].any()  # at y = -4 it is still beside
    assert blocked[1, 30 * 4]  # at y = 0
    assert not blocked[2, 30 * 4]  # long gone
    assert blocked[:, 50 * 4].all()  # stands


def test_whoever_stands_in_the_way_plans_first() -> None:
    behind = STRAIGHT - (6.0, 0.0)
    fleet = FleetPaths({"0": build_path(behind, REAR), "1": straight_path()}, SIZE)
    assert fleet.find_blocking_starts("0") == {"1"}
    assert fleet.find_blocking_starts("1") == frozenset()
    tasks = {name: free_task(path) for name, path in fleet.path_by_ego.items()}
    assert find_planning_order(fleet, tasks) == ("1", "0")


def test_profiles_go_on_at_their_last_speed() -> None:
    profile = SpeedProfile(np.array([0.0, 0.25, 1.0]), np.array([0.0, 1.0, 2.0]), reaches_goal=True)
    assert profile.get_stations(np.array([0.25, 0.5, 1.0, 3.0])) == pytest.approx([0.0625, 0.25, 1.0, 5.0])


def test_footprints_are_where_the_path_is() -> None:
    corners = compute_footprints(straight_path(), *SIZE, np.array([40]))
    assert corners[0].mean(0) == pytest.approx((10.0, 0.0), abs=0.01)
    assert np.ptp(corners[0], axis=0) == pytest.approx(SIZE, abs=0.01)
