"""The least arrival time of a safe driver, compared with drives that are simulated tick by tick."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from testing.blind_corner import CAR, LIMIT, BlindCorner

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor, Pose
from mdrive_sumo.study.need.motion import MotionLimits, build_route_motion
from mdrive_sumo.study.need.route_search import find_safe_arrival
from mdrive_sumo.study.need.speed_grid import SpeedGrid
from mdrive_sumo.study.need_certificate import NeedRoute, Proof, certify_need, find_cautious_arrival

MASTS = tuple(RoadsideUnit(id=f"mast{k}", x=70.0 + 40.0 * k, y=-20.0) for k in range(2))
CYCLIST = BlindCorner(kind=Kind.CYCLIST, speed=7.0, is_cav=False, gap=1.0, side=1.3, rsus=MASTS)
"""Hidden until late, but a CAV that is slow enough meets it."""
CLOSE = replace(CYCLIST, gap=0.3)
"""Comes out so close behind the wall that no speed helps: the CAV's nose is in its way before the CAV sees it."""
TICKS = 500
LATEST_S = 18.0
"""Later drives are not looked at: their time near a crossing has more starts than are tried."""


@cache
def arrive(corner: BlindCorner) -> float:
    """Return the bound for "a" [s], infinite if no driver is safe."""
    found = find_cautious_arrival(corner.scenario, corner.roads, corner.record)["a"]
    return math.inf if found is None else found


def drive(targets: Float, segment_m: float) -> tuple[Float, Float]:
    """Return (D, T) stations [m] and speeds [m/s] of drives that aim at (D, S) speeds on segments of the route."""
    drives = np.arange(len(targets))
    x, v = np.zeros(len(targets)), np.zeros(len(targets))
    stations, speeds = [], []
    for _ in range(TICKS):
        stations.append(x)
        speeds.append(v)
        aim = targets[drives, np.minimum((x / segment_m).astype(int), targets.shape[1] - 1)]
        v = np.clip(aim, np.maximum(v - 8.0 * DT, 0.0), v + 4.4 * DT)
        x = x + v * DT
    return np.stack(stations, axis=1), np.stack(speeds, axis=1)


def find_safe(corner: BlindCorner, stations: Float, speeds: Float) -> Bool:
    """Return (D,) which drives can avoid the road user of each crossing for all its starts, once they see it.

    After the first tick with a clear line from the centre of the CAV past the corner of the wall, a drive brakes with
    8.3 m/s2 or accelerates with 4.5 m/s2, whichever helps.
    """
    safe = np.ones(len(stations), dtype=np.bool_)
    for crossing_x in corner.crossings:
        near = np.argmax(stations >= crossing_x - 6.0, axis=1)
        for shift in range(-30, 240, 2):
            left = np.flatnonzero(safe)
            y = (np.arange(TICKS) - (near[left] + shift)[:, None]) * DT * corner.speed
            safe[left] = avoids(corner, crossing_x, stations[left], speeds[left], y)
    return safe


def avoids(corner: BlindCorner, crossing_x: float, stations: Float, speeds: Float, y: Float) -> Bool:
    """Return (D,) whether the drives avoid a road user at (crossing_x, y), y: (D, T)."""
    dx = crossing_x - CAR[1] / 2 - corner.gap - stations
    with np.errstate(divide="ignore"):
        line = np.where(dx > 0.0, -corner.side * (crossing_x + CAR[1] / 2 - stations) / dx, -np.inf)
    sees = y + CAR[0] / 2 > line
    first = np.where(sees.any(axis=1), sees.argmax(axis=1), TICKS - 1)
    both = [hits(crossing_x, react(stations, speeds, first, gain), y) for gain in (-8.3, 4.5)]
    return ~np.asarray(np.stack(both).all(axis=0))


def react(stations: Float, speeds: Float, first: Int, gain: float) -> Float:
    """Return (D, T) the stations of drives that change their speed by `gain` [m/s2] from a tick (D,) on."""
    rows = np.arange(len(stations))
    seconds = np.maximum(np.arange(TICKS) - first[:, None], 0) * DT
    v, x = speeds[rows, first][:, None], stations[rows, first][:, None]
    if gain < 0.0:
        seconds = np.minimum(seconds, v / -gain)
    changed = x + v * seconds + gain * seconds * seconds / 2.0
    return np.where(np.arange(TICKS) <= first[:, None], stations, changed)


def hits(crossing_x: float, stations: Float, y: Float) -> Bool:
    """Return (D,) whether the boxes overlap in a tick."""
    along = np.abs(stations - crossing_x) < (CAR[0] + CAR[1]) / 2
    return np.asarray((along & (np.abs(y) < (CAR[0] + CAR[1]) / 2)).any(axis=1))


def time_arrivals(corner: BlindCorner, stations: Float) -> Float:
    """Return (D,) when drives pass the least station at which the route counts as completed [s]; infinite if never."""
    goal_m = build_route_motion(corner.scenario.egos[0], corner.roads, MotionLimits()).goal_m
    passed = stations >= goal_m
    return np.where(passed.any(axis=1), passed.argmax(axis=1) * DT, np.inf)


def draw_targets(count: int, segments: int) -> Float:
    """Return (count, segments) target speeds [m/s]: the limit, walking pace, or anything between."""
    rng = np.random.default_rng(91)
    free = rng.uniform(0.5, LIMIT, (count, segments))
    kind = rng.random((count, segments))
    return np.where(kind < 0.5, LIMIT, np.where(kind < 0.65, rng.uniform(0.4, 4.0, (count, segments)), free))


def list_slow_places(corner: BlindCorner) -> Float:
    """Return (D, S) target speeds on metres of the route: the limit, but one low speed before every crossing."""
    rows = []
    for speed in np.arange(0.5, 9.0, 0.5).tolist():
        for begin_m in range(2, 24, 2):
            for end_m in range(-4, 8, 2):
                row = np.full(round(corner.length) + 5, LIMIT)
                for crossing_x in corner.crossings:
                    row[round(crossing_x) - begin_m : max(round(crossing_x) - end_m, 0)] = speed
                rows.append(row)
    return np.array(rows)


def test_the_grid_knows_the_least_time_on_a_free_road() -> None:
    motion = build_route_motion(CYCLIST.scenario.egos[0], CYCLIST.roads, MotionLimits())
    rising_s = LIMIT / 4.5  # from a standstill to the limit, then on at the limit
    least_s = rising_s + (motion.goal_m - LIMIT * rising_s / 2.0) / LIMIT
    assert least_s - 0.2 < find_safe_arrival(SpeedGrid(motion), ()).time_s < least_s


@pytest.mark.parametrize("speed", [0.0, 0.3, 4.0, 13.0])
def test_a_real_step_has_a_way_through_the_cells(speed: float) -> None:
    grid = SpeedGrid(build_route_motion(CYCLIST.scenario.egos[0], CYCLIST.roads, MotionLimits()))
    times = np.full(len(grid.bounds) - 1, np.inf)
    times[grid.find_cell(speed)] = 3.0
    after = grid.advance(times, 50)
    for gain in (-8.0, -3.0, 0.0, 2.0, 4.5):
        squared = speed * speed + gain  # v² + 2 a s over 0.5 m
        if squared > 0.0 and squared < LIMIT * LIMIT:
            seconds = (math.sqrt(squared) - speed) / gain if gain else 0.5 / max(speed, 1e-9)
            assert after[grid.find_cell(math.sqrt(squared))] <= 3.0 + seconds + 1e-9
    faster = grid.find_cell(math.sqrt(speed * speed + 1.3 * 4.5)) + 1
    assert not np.isfinite(after[faster:]).any()


@pytest.mark.slow
def test_a_hidden_cyclist_costs_time_and_a_second_one_costs_more() -> None:
    free, one = arrive(replace(CYCLIST, has_wall=False)), arrive(CYCLIST)
    assert free + 0.5 < one < free + 3.0
    both, open_road = replace(CYCLIST, corners=2), replace(CYCLIST, corners=2, has_wall=False)
    assert arrive(both) - arrive(open_road) == pytest.approx(2.0 * (one - free), rel=0.25)


@pytest.mark.slow
def test_no_driver_is_safe_where_the_nose_is_in_the_way_before_the_cyclist_is_seen() -> None:
    assert arrive(CLOSE) == math.inf
    certificate = certify_need(CLOSE.scenario, CLOSE.roads, CLOSE.record)
    assert certificate.proves is Proof.ALL
    assert certificate.proves_over_roofs is Proof.ALL
    assert [conflict.proves for conflict in certificate.conflicts] == [Proof.ALL]
    assert certificate.routes[0].road_users == ("b",)


def test_what_stands_alone_in_the_way_or_x_proves_nothing() -> None:
    assert math.isfinite(arrive(replace(CLOSE, has_wall=False)))
    assert math.isfinite(arrive(replace(CLOSE, rsus=())))


def test_a_car_that_sees_the_nose_brakes_unless_it_avoids_no_collision() -> None:
    car = replace(CLOSE, kind=Kind.VEHICLE, speed=10.0)
    pose = Pose(x=60.0, y=-50.0, yaw=1.57)
    actor = Actor(id="b", kind="vehicle", length=4.9, width=2.0, start=pose, avoid_collision=False)
    scripted = car.scenario.model_copy(update={"actors": (actor,)})
    assert math.isfinite(arrive(car))
    assert find_cautious_arrival(scripted, car.roads, car.record) == {"a": None}


def test_the_arrival_does_not_depend_on_the_limit_and_more_time_never_proves_more() -> None:
    found = [arrive(replace(CYCLIST, time_limit_s=limit)) for limit in (8.2, 12.0)]
    assert found[0] == found[1]
    route = NeedRoute(
        ego="a", time_limit_s=8.2, free_s=7.8, cautious_s=8.5, cautious_over_roofs_s=8.1, road_users=("b",)
    )
    by_limit = [route.model_copy(update={"time_limit_s": limit}).proves for limit in (7.0, 7.8, 8.4, 8.5, 30.0)]
    assert by_limit == [None, Proof.ALL, Proof.ALL, None, None]
    assert route.proves_over_roofs is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gap", "side", "is_possible", "corners"),
    [
        (1.0, 1.3, False, 1),
        (2.0, 3.0, True, 2),
        *(
            pytest.param(*case, marks=pytest.mark.full)
            for case in ((0.3, 1.3, False, 1), (0.3, 1.3, False, 2), (1.0, 1.3, False, 2), (2.0, 3.0, True, 1))
        ),
    ],
)
def test_no_simulated_drive_is_safe_and_earlier_than_the_bound(
    gap: float, side: float, is_possible: bool, corners: int
) -> None:
    corner = replace(CYCLIST, gap=gap, side=side, corners=corners)
    targets = np.repeat(draw_targets(3000, round(corner.length / 5.0) + 1), 5, axis=1)
    stations, speeds = drive(np.concatenate((targets[:, : round(corner.length) + 5], list_slow_places(corner))), 1.0)
    arrivals = time_arrivals(corner, stations)
    stations, speeds, arrivals = (values[arrivals <= LATEST_S] for values in (stations, speeds, arrivals))
    safe = find_safe(corner, stations, speeds)
    assert is_possible or (arrivals < arrive(corner)).sum() > 100
    assert not (safe & (arrivals < arrive(corner))).any()
    assert safe.any() == is_possible
    if is_possible:  # with the arrival of a drive that is safe as the limit, `all` does not hold
        assert arrive(corner) <= arrivals[safe].min() < arrive(corner) + 2.0 * corners
