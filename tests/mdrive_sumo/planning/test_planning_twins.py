"""Compiled functions of planning against their Python text, on random inputs."""

import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.contract import Cause, Objects, Reason, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.planning.car_following import Travel, VehiclesAhead
from mdrive_sumo.planning.detour import LateralShift
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import AVOIDANCE, DETOUR, INTERACTION, PEDESTRIAN, RIGHT_OF_WAY, SafetyMargin
from mdrive_sumo.planning.reference_path import ReferencePath, build_path
from mdrive_sumo.planning.right_of_way import EgoMotion
from mdrive_sumo.planning.road_direction import RoadDirection, RoadPosition
from mdrive_sumo.planning.speed_lattice import build_transitions, choose_lattice
from mdrive_sumo.planning.speed_profile import SpeedProfile, SpeedProfileProblem
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

TWINS = [
    import_module(f"mdrive_sumo.planning.{name}")
    for name in (
        "detour",
        "fleet_paths",
        "free_drive",
        "interaction_prediction",
        "motion_conflicts",
        "moving_traffic",
        "obstacle_avoidance",
        "pedestrian_caution",
        "profile_search",
    )
]
"""Modules whose functions are compared, most of which are used by name only."""
SEEDS = st.integers(0, 2**32 - 1)
VEHICLE: VehicleFacts = to_vehicle_facts(MKZ_2017)
_S = np.arange(121.0)
PATH: ReferencePath = build_path(np.column_stack((_S, 20 * portable.sin(_S / 30))), VEHICLE.rear_to_centre)
BAD = (float("nan"), float("inf"), -float("inf"), 1e200)


def random_boxes(rng: np.random.Generator, count: int) -> Float:
    """Boxes of which some are degenerate, and some of which are no numbers."""
    x, y = rng.uniform(-30.0, 30.0, (2, count))
    length, width = rng.choice((0.0, 2.0, rng.uniform(1.0, 12.0)), count), rng.uniform(0.0, 3.0, count)
    boxes = boxes_corners(np.round(x), np.round(y), rng.uniform(-3.2, 3.2, count) * rng.choice((0, 1)), length, width)
    if count and rng.random() < 0.3:
        boxes[rng.integers(count), rng.integers(4), rng.integers(2)] = rng.choice(BAD)
    return boxes


@given(seed=SEEDS)
def test_overlaps_of_boxes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, others = (random_boxes(rng, int(rng.choice((0, 1, 5, 60)))) for _ in range(2))
    compare_twins("planning_path_overlap_compute_overlaps", boxes, others)
    compare_twins("planning_path_overlap_find_overlapping_pairs", boxes, others)


def random_motion(rng: np.random.Generator) -> PredictedMotion:
    rows, yaw = int(rng.integers(0, len(TIMES) + 1)), rng.uniform(-3.2, 3.2)
    travelled = np.minimum(rng.uniform(0.0, 15.0) * TIMES[:rows], rng.choice((0.0, 30.0)))
    x, y = rng.uniform(-5.0, 120.0), rng.uniform(-20.0, 20.0)
    poses = np.column_stack((x + travelled * portable.cos(yaw), y + travelled * portable.sin(yaw), np.full(rows, yaw)))
    length = 5.0 + np.floor(travelled / 9) if rng.random() < 0.5 else 5.0
    gap_m = float(rng.choice((0.0, 0.5, 3.0)))
    return PredictedMotion(poses, length, 2.0, Reason(Cause.AVOID), bool(rng.random() < 0.5), gap_m)


@pytest.mark.slow
@given(seed=SEEDS)
def test_conflicts_with_motions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motions = [random_motion(rng) for _ in range(int(rng.integers(0, 5)))]
    boxes = compare_twins("planning_motion_conflicts_list_predicted_boxes", motions)
    margin = SafetyMargin(*rng.uniform(0.0, 2.0, 2).tolist())
    cells = np.sort(rng.integers(0, len(PATH.xy), int(rng.choice((0, 1, 20, 90)))))
    arguments = PATH, VEHICLE, boxes, cells, margin
    compare_twins("planning_motion_conflicts_find_blocked", *arguments, int(rng.integers(1, 4)))
    compare_twins("planning_motion_conflicts_find_blocked_after", *arguments)
    compare_twins("planning_motion_conflicts_find_met", *arguments)
    compare_twins("planning_motion_conflicts_find_first_met", *arguments)


def random_objects(rng: np.random.Generator) -> Objects:
    """Road users near the first 60 m of `PATH`; some are level with a car at its beginning."""
    count = int(rng.choice((0, 1, 3, 12)))
    ids = tuple(f"track {i}" for i in range(count))
    x, y = np.round(rng.uniform(-10.0, 60.0, count)), np.round(rng.uniform(-15.0, 15.0, count))
    yaw = rng.choice((0.0, 0.3, np.pi / 2, -2.0, rng.uniform(-3.2, 3.2)), count)
    speed = rng.choice((0.0, 0.3, -0.4, rng.uniform(0.0, 14.0)), count)
    size = rng.uniform(0.0, 12.0, count), rng.uniform(0.5, 3.0, count)
    columns = [x, y, yaw, speed, *size]
    if count and rng.random() < 0.1:
        columns[rng.integers(6)][rng.integers(count)] = rng.choice(BAD)
    return Objects(ids, rng.integers(0, 4, count).astype(np.uint8), *columns)


@pytest.mark.slow
@given(seed=SEEDS)
def test_right_of_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects, name = random_objects(rng), "planning_right_of_way_{}".format
    parameters = replace(RIGHT_OF_WAY, look_ahead_m=60.0, stride_m=1.5) if rng.random() < 0.5 else RIGHT_OF_WAY
    preview = compare_twins(name("preview_path"), PATH, float(rng.uniform(-5.0, 130.0)), VEHICLE, parameters)
    ego = EgoMotion((0.0, float(rng.integers(-3, 3))), 5.0, 8.0, 2.0)
    for function in ("find_lead_objects", "find_rows_on_path", "find_followers_beside"):
        compare_twins(name(function), ego, preview, objects, parameters)
        compare_twins(name(function), ego, preview, objects)
    compare_twins(name("find_same_direction"), preview, objects, parameters)
    before = {f"track {i}": float(rng.uniform(-3.2, 3.2)) for i in range(4)}
    compare_twins(name("estimate_curvatures"), objects, before, 0.2, parameters)
    curvature = rng.choice((0.0, 0.1, -0.3), len(objects.ids))
    compare_twins(name("find_crossing_conflicts"), preview, objects, curvature, parameters)
    compare_twins(name("find_crossing_conflicts"), preview, objects, curvature)


@given(seed=SEEDS)
def test_motions_of_road_users(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects, name = random_objects(rng), "planning_interaction_prediction_{}".format
    for row in range(len(objects.ids)):
        curvature, top_speed = float(rng.choice((0.0, 0.1, -0.3))), float(rng.choice((3.0, 8.0, 20.0)))
        compare_twins(name("predict_merging"), objects, row, curvature)
        compare_twins(name("predict_crossing"), objects, row, curvature, bool(rng.random() < 0.5), top_speed)
        place = float(rng.uniform(0.0, 40.0)), 40.0, VEHICLE.length, float(rng.choice((0.0, 0.1, 1.0)))
        compare_twins(name("predict_lead_object"), objects, row, PATH, *place, INTERACTION)


@given(seed=SEEDS)
def test_speed_profiles_and_free_drives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lattice, points = choose_lattice(float(rng.choice((8.0, 13.9, 33.3)))), int(rng.integers(1, 30))
    profile = SpeedProfile(
        np.cumsum(rng.uniform(0.0, 5.0, points)), rng.uniform(0.0, 9.0, points), True, lattice.step_s
    )
    times = np.concatenate((rng.uniform(-9.0, 40.0, int(rng.integers(0, 9))), np.arange(4) * lattice.step_s))
    compare_twins("planning_speed_profile_compute_stations", profile, times)
    compare_twins("planning_speed_profile_compute_station", profile, float(times[-1]))
    speeds = rng.uniform(0.0, 40.0, int(rng.integers(9, 200)))
    compare_twins("planning_speed_profile_list_cells", speeds, lattice, float(rng.uniform(-1.0, 60.0)), 3 * points)
    start, limits = float(rng.uniform(0.0, 60.0)), (2.0, 4.0, float(rng.choice((0.2, 0.25))))
    compare_twins("planning_free_drive_drive_freely", speeds, start, float(rng.uniform(0.0, 40.0)), *limits, points)
    for place in (-9.0, math.nan, math.inf):
        compare_twins("planning_free_drive_drive_freely", speeds, place, 5.0, *limits, points)


@pytest.mark.slow
@given(seed=SEEDS)
def test_obstacles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, s = random_boxes(rng, int(rng.integers(0, 9))), float(rng.uniform(0.0, 140.0))
    compare_twins("planning_detour_find_obstructing_boxes", PATH, s, boxes, VEHICLE)
    compare_twins("planning_detour_find_obstructing_boxes", PATH, s, boxes, VEHICLE, replace(DETOUR, look_ahead_m=9.0))
    for points in (rng.uniform(-30.0, 30.0, shape) for shape in ((5, 2), (0, 4, 2), (3, 4, 2))):
        compare_twins("planning_detour_to_frenet", PATH.xy[50:200], PATH.yaw[50:200], points)
    hold, ramps = np.sort(rng.uniform(0.0, 140.0, 2)).tolist(), rng.uniform(1.0, 30.0, 2).tolist()
    shift = LateralShift(float(rng.choice((0.0, 3.5, -2.0, rng.uniform(-9.0, 9.0)))), (hold[0], hold[1]), (*ramps,))
    compare_twins("planning_detour_apply_shift", PATH, shift, VEHICLE.rear_to_centre)
    bad = float(rng.choice(BAD[:3])), float(rng.choice(hold))
    for hold_s in (bad, bad[::-1]):
        compare_twins("planning_detour_apply_shift", PATH, shift._replace(hold=hold_s), VEHICLE.rear_to_centre)
    bent = replace(PATH, yaw=np.insert(np.delete(PATH.yaw, 0), int(rng.integers(len(PATH.yaw) - 1)), bad[0]))
    bent.__dict__["body_yaw"] = PATH.body_yaw
    compare_twins("planning_detour_apply_shift", bent, shift, VEHICLE.rear_to_centre)
    objects = random_objects(rng)
    standstill_s = rng.choice((0.0, 1.0, 2.0, 9.0), len(objects.ids))
    compare_twins("planning_obstacle_avoidance_find_queued", objects, standstill_s, AVOIDANCE)


@given(seed=SEEDS)
def test_paths_of_fleets(seed: int) -> None:
    rng = np.random.default_rng(seed)
    name, points = "planning_fleet_paths_{}".format, np.round(rng.uniform(-20.0, 140.0, (int(rng.integers(0, 9)), 2)))
    for coarse in (1, 8):
        compare_twins(name("locate_points"), PATH.xy[: int(rng.integers(1, 480))], points, coarse)
    own_points, other_points, stride = *rng.integers(1, 40, 2).tolist(), int(rng.integers(1, 4))
    shape = [(points - 1) // stride + 1 for points in (own_points, other_points)]
    is_transposed = bool(rng.random() < 0.5)
    table, cells = rng.random(shape[::-1] if is_transposed else shape) < 0.3, rng.integers(-1, own_points, 7)
    stations, end_s = rng.uniform(-2.0, 12.0, 5), float(rng.uniform(0.0, 12.0))
    compare_twins(name("look_up_overlaps"), table, is_transposed, cells, stations, stride, other_points, end_s)
    cells, times = np.sort(rng.integers(0, 480, int(rng.integers(0, 40)))), np.arange(int(rng.integers(0, 60))) * 0.25
    margin = SafetyMargin(*rng.uniform(0.0, 1.0, 2).tolist())
    arguments = PATH, cells, random_objects(rng), times, (4.9, 2.0), margin
    compare_twins(name("find_cells_blocked_by_objects"), *arguments)


@given(seed=SEEDS)
def test_traffic_on_roads(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects, stations = random_objects(rng), np.cumsum(rng.uniform(0.5, 5.0, int(rng.integers(1, 40))))
    road = RoadDirection(stations, rng.uniform(-7.0, 7.0, len(stations)), rng.uniform(-50.0, 50.0, (len(stations), 2)))
    compare_twins("planning_road_direction_locate_objects", road, PATH, objects)
    some = np.concatenate((rng.uniform(-5.0, 99.0, int(rng.integers(0, 9))), stations[:2]))
    compare_twins("planning_road_direction_find_points", road, some)
    moving, times = random_objects(rng), np.arange(1, int(rng.integers(2, 12))) * 0.5
    shape = len(times), len(moving.ids)
    travel = Travel(np.cumsum(rng.uniform(0.0, 9.0, shape), axis=0), rng.uniform(0.0, 30.0, shape))
    position = RoadPosition(*rng.uniform(-9.0, 99.0, (3, shape[1])))
    lanes = rng.random(shape[1]) < 0.7, rng.choice((-1.0, 1.0), shape[1]), rng.random(shape[1]) < 0.5
    arguments = road, moving, position, travel, *lanes, times, 0.9, 0.5, 0.1, float(rng.choice((0.6, 7.0)))
    compare_twins("planning_moving_traffic_place_traffic", *arguments)
    first = {name: (float(rng.uniform(-9.0, 9.0)), 0.0) for name in objects.ids[::2]}
    compare_twins("planning_pedestrian_caution_predict_walking_speeds", objects, first, PEDESTRIAN)
    count = int(rng.integers(0, 6))
    speed, acceleration = rng.uniform(-1.0, 30.0, count), rng.choice((0.0, 0.9, 3.0, -1.0, -12.0), count)
    ahead = VehiclesAhead(rng.integers(-1, max(count, 1), count), rng.uniform(-3.0, 40.0, count))
    times = np.sort(rng.uniform(-3.0, 12.0, int(rng.integers(0, 9))))
    compare_twins("planning_car_following_predict_travel", speed, acceleration, ahead, 20.0, times)


def random_problem(rng: np.random.Generator) -> SpeedProfileProblem:
    lattice = choose_lattice(float(rng.choice((8.0, 13.9, 22.0, 33.3))))
    cells, layers = int(rng.integers(1, 90)), int(rng.integers(0, 16))
    blocked = np.zeros((layers * lattice.samples, cells), dtype=np.bool_)
    for _ in range(int(rng.integers(0, 5))):
        if blocked.size:
            row, cell = int(rng.integers(len(blocked))), int(rng.integers(cells))
            blocked[row : row + int(rng.integers(1, 30)), cell : cell + int(rng.integers(1, 9))] = True
    goal = int(rng.integers(cells + 3))
    return SpeedProfileProblem(
        start_s=float(rng.uniform(0.0, 50.0)),
        speed=float(rng.choice((0.0, rng.uniform(0.0, 40.0)))),
        cells=np.arange(cells),
        limits=rng.integers(0, lattice.top + 3, cells),
        goals=slice(goal, None) if rng.random() < 0.5 else slice(goal, goal + int(rng.integers(1, 6))),
        blocked=blocked,
        must_move=rng.random(layers) < rng.choice((0.0, 0.3)),
        ends_standing=bool(rng.random() < 0.3),
        wait_penalty=float(rng.choice((0.0, 0.05))),
        lattice=lattice,
        blocked_after=rng.random(cells if rng.random() < 0.5 else 0) < 0.1,
    )


@given(seed=SEEDS)
def test_searches_of_speed_profiles(seed: int) -> None:
    problem = random_problem(np.random.default_rng(seed))
    compare_twins("planning_profile_search_search_profile", problem, build_transitions(problem.lattice))


@pytest.mark.parametrize("speed", [float("nan"), float("inf")])
def test_a_speed_that_is_no_number_is_refused(speed: float) -> None:
    problem = SpeedProfileProblem(0.0, speed, np.zeros(1, np.int64), np.ones(1, np.int64), slice(0, None),
                                  np.zeros((0, 1), np.bool_), np.zeros(0, np.bool_))  # fmt: skip
    compare_twins("planning_profile_search_search_profile", problem, build_transitions(problem.lattice))
