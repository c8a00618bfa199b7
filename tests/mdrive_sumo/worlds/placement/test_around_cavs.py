"""What stands and drives around CAVs on lane routes: start speeds, traffic near them, parked vehicles, obstacles."""

import random
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.learning.training_situations import SITUATIONS, SituationPlan
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.vehicle.dynamics import MKZ_2017
from mdrive_sumo.worlds.encounters.route_actors import fit_to_lane_width, is_behind_bend
from mdrive_sumo.worlds.placement.cavs import build_cav
from mdrive_sumo.worlds.placement.occupancy import locate_departure, select_free_actors
from mdrive_sumo.worlds.placement.parked_vehicles import build_parked_vehicles
from mdrive_sumo.worlds.placement.route_cavs import build_route_cavs
from mdrive_sumo.worlds.placement.start_speeds import draw_road_speeds, draw_start_speeds
from mdrive_sumo.worlds.streams.near_traffic import TrafficRequest, build_near_traffic

CAR = MKZ_2017.length, MKZ_2017.width
SEEDS = range(12)


@lru_cache
def load(network: str) -> RoadMap:
    return load_road_map(find_network_folder(network))


# --- CAVs ---------------------------------------------------------------------------------------------------------


def straight(x: float = 0.0, y: float = 0.0, bend: float = 0.0, name: str = "1") -> Ego:
    """A CAV at rest on a route of 60 m to the east that bends after 10 m by that angle [rad]."""
    yaw = np.where(np.arange(61) < 10, 0.0, bend)
    xy = np.cumsum(np.column_stack((np.cos(yaw), np.sin(yaw))), axis=0) - (1.0, 0.0) + (x, y)
    route = tuple((float(a), float(b), float(c)) for (a, b), c in zip(xy, yaw, strict=True))
    return Ego(id=name, start=Pose(x=x, y=y, yaw=0.0), lanes=("a_0",), route=route)


def moving_share(egos: list[Ego], others: list[shapely.Polygon]) -> float:
    drawn = [draw_start_speeds(egos, others, random.Random(seed))[0].start_speed for seed in range(200)]
    assert all(speed == 0.0 or 2.0 <= speed <= 8.0 for speed in drawn)
    return sum(speed > 0.0 for speed in drawn) / len(drawn)


def box(x: float, y: float) -> shapely.Polygon:
    return shapely.Polygon(box_corners(x, y, 0.0, 4.0, 1.8))


def test_a_third_of_the_cavs_with_a_free_road_start_with_a_speed() -> None:
    assert 0.25 < moving_share([straight()], []) < 0.45
    assert 0.25 < moving_share([straight(bend=0.2)], [box(6.0, 3.5), box(-5.0, 0.0), box(27.0, 0.0)]) < 0.45


@pytest.mark.parametrize(
    ("egos", "others"),
    [
        pytest.param([straight()], [box(20.0, 0.0)], id="vehicle ahead"),
        pytest.param([straight()], [box(12.0, 3.2)], id="vehicle half in the lane"),
        pytest.param([straight(), straight(x=15.0, name="2")], [], id="CAV ahead"),
        pytest.param([straight(bend=0.4)], [], id="bend"),
        pytest.param([straight(bend=-0.4)], [], id="bend to the right"),
    ],
)
def test_no_cav_starts_with_a_speed_towards_something_or_into_a_bend(
    egos: list[Ego], others: list[shapely.Polygon]
) -> None:
    assert moving_share(egos, others) == 0.0


def drive_on_road(network: str, others: list[shapely.Polygon], ahead_m: float = 0.0) -> list[tuple[Ego, ...]]:
    """CAVs on the longest lane of a network, the second so far ahead of the first, with the speeds of many seeds."""
    roads = load(network)
    lane = max((one for one in roads.driving if not one.junction), key=lambda one: one.centre.length)
    cavs = [build_cav(roads, str(k), (lane.id,), (5.0 + k * ahead_m, lane.centre.length - 2.0), 0.0) for k in (0, 1)]
    return [draw_road_speeds(roads, cavs[: 1 + (ahead_m > 0)], others, random.Random(seed)) for seed in range(60)]


def test_at_road_speed_cavs_drive_at_one_share_of_the_limit_or_stand() -> None:
    speeds = [egos[0].start_speed for egos in drive_on_road("freeway", [])]
    limit = max(lane.speed_limit for lane in load("freeway").driving)
    assert 0.1 < sum(speed == 0.0 for speed in speeds) / len(speeds) < 0.4
    assert all(speed == 0.0 or 0.39 * limit < speed < 0.96 * limit for speed in speeds)


@pytest.mark.parametrize("way_m", [6.0, 20.0, 50.0])
def test_a_cav_at_road_speed_can_stop_before_what_stands_ahead(way_m: float) -> None:
    """With 3 m/s2, 8 m from its centre: not at all 6 m ahead, from 8.5 m/s 20 m ahead, from 15.9 m/s 50 m ahead."""
    roads = load("freeway")
    lane = max((one for one in roads.driving if not one.junction), key=lambda one: one.centre.length)
    (x, y), yaw = lane.centre.at(5.0 + way_m + 2.0), lane.centre.yaw_at(5.0 + way_m)
    standing = shapely.Polygon(box_corners(x, y, yaw, 4.0, 1.8))
    fastest = max(egos[0].start_speed for egos in drive_on_road("freeway", [standing]))
    assert fastest == pytest.approx({6.0: 0.0, 20.0: 8.49, 50.0: 15.87}[way_m], abs=0.3)


def test_a_cav_behind_another_one_drives_no_faster_than_it_may_follow() -> None:
    for first, second in drive_on_road("freeway", [], ahead_m=14.0):
        rear_m = 14.0 - CAR[0] / 2
        assert first.start_speed**2 <= second.start_speed**2 + 6.0 * (rear_m - 8.0) + 0.5


def place_cavs(kind: str, network: str, seed: int) -> tuple[RoadMap, SituationPlan, dict[str, Ego]]:
    roads, rng = load(network), random.Random(seed)
    plan = SITUATIONS[kind].draw(roads, rng)
    assert plan is not None
    return roads, plan, build_route_cavs(plan.ways, plan.route_m, roads, rng)


@pytest.mark.parametrize("network", ["side_street", "village_street"])
def test_a_single_cav_has_a_route_on_its_lanes_within_the_bounds(network: str) -> None:
    for seed in SEEDS:
        _, plan, egos = place_cavs("lone", network, seed)
        (ego,) = egos.values()
        assert ego.start_speed == 0.0
        length = float(np.hypot(*np.diff(ego.xy, axis=0).T).sum())
        assert 30.0 <= length <= plan.route_m[1] + 1.0
        assert ego.xy[0] == pytest.approx((ego.start.x, ego.start.y), abs=0.5)


# --- background vehicles ------------------------------------------------------------------------------------------


def build_traffic(request: TrafficRequest, seed: int) -> tuple[RoadMap, Ego, tuple[BackgroundVehicle, ...]]:
    roads, _, egos = place_cavs("lone", "main_street", seed)
    (ego,) = egos.values()
    return roads, ego, build_near_traffic(roads, (ego,), (), request, random.Random(seed))


@pytest.mark.slow
@pytest.mark.parametrize("is_jammed", [False, True])
def test_traffic_at_the_start_has_room_and_no_more_speed_than_room(is_jammed: bool) -> None:
    for seed in range(3):
        roads, ego, vehicles = build_traffic(TrafficRequest(0, 24, is_jammed), seed)
        present = [one for one in vehicles if one.depart_s == 0.0]
        assert [one.id for one in vehicles] == [f"bg{k}" for k in range(len(vehicles))]
        assert len(present) >= 8 and len(vehicles) - len(present) == 24 - round(0.75 * 24)
        start = shapely.Polygon(box_corners(ego.start.x, ego.start.y, ego.start.yaw, *CAR))
        boxes = [locate_departure(one, roads) for one in present]
        for k, one in enumerate(boxes):
            assert min(one.distance(other) for other in (start, *boxes[:k])) >= 0.5 - 1e-6
        near = shapely.Point(ego.start.x, ego.start.y).buffer(75.0)
        assert is_jammed or all(one.intersects(near) for one in boxes)
        for one in present:
            lane = roads.lanes[f"{one.edges[0]}_{one.depart_lane}"]
            assert one.length < one.depart_pos_m <= lane.centre.length
            assert one.depart_speed <= 0.3 * (lane.centre.length - one.depart_pos_m) + 0.01
            assert one.depart_speed <= 0.6 * lane.speed_limit + 0.01


def test_vehicles_that_enter_later_come_apart_and_in_order() -> None:
    for seed in range(3):
        _, _, vehicles = build_traffic(TrafficRequest(0, 40), seed)
        entering = [one for one in vehicles if one.depart_s > 0.0]
        departures = [one.depart_s for one in entering]
        assert departures == sorted(departures)
        by_lane: dict[tuple[str, int], list[float]] = {}
        for one in entering:
            by_lane.setdefault((one.edges[0], one.depart_lane), []).append(one.depart_s)
        assert all(np.diff(times).min(initial=9.0) >= 3.0 - 0.02 for times in by_lane.values())
        assert min(departures) >= 1.0


def test_a_queue_stands_ahead_of_the_first_cav_bumper_to_bumper() -> None:
    lengths: list[int] = []
    for seed in range(8):
        roads, ego, queue = build_traffic(TrafficRequest(3, 0), seed)
        lane = roads.lanes[ego.lanes[0]]
        front_m = lane.centre.project(ego.start.x, ego.start.y)[0] + CAR[0] / 2
        for one in queue:
            assert (one.depart_s, one.depart_speed, one.edges[0]) == (0.0, 0.0, lane.edge)
            gap_m = one.depart_pos_m - one.length - front_m
            assert 2.0 - 0.02 <= gap_m <= 4.0 + 0.02 or (one.id == "bg0" and 8.0 - 0.02 <= gap_m <= 22.0 + 0.02)
            front_m = one.depart_pos_m
        lengths.append(len(queue))
    assert max(lengths) == 3


# --- parked vehicles, obstacles -----------------------------------------------------------------------------------


def test_parked_vehicles_stand_at_the_right_edge_of_a_road_and_away_from_its_ends() -> None:
    roads, _, egos = place_cavs("lone", "side_street", 1)
    parked = list(build_parked_vehicles(roads, list(egos.values()), 40, random.Random(3)))
    assert len(parked) == 40
    for one in parked:
        lane = roads.driving[roads.find_nearest_lanes(np.array([[one.start.x, one.start.y]])).lane[0]]
        s, offset = lane.centre.project(one.start.x, one.start.y)
        edge_m = -offset - lane.width / 2 - one.width / 2
        assert -0.31 <= edge_m <= 0.61
        assert s - one.length / 2 >= 6.0 - 0.1 and s + one.length / 2 <= lane.centre.length - 6.0 + 0.1
        assert one.start.yaw == pytest.approx(lane.centre.yaw_at(s), abs=0.01)


def actor(id_: str, x: float, y: float) -> Actor:
    return Actor(id=id_, kind="vehicle", length=4.0, width=1.8, start=Pose(x=x, y=y, yaw=0.0))


def test_actors_need_room_and_parked_ones_leave_the_routes_free() -> None:
    roads = replace(load("village_street"), buildings=())
    everything = (
        actor("block", 20.0, 0.5),  # an obstacle may stand in a route, not in another one
        actor("block_2", 21.0, 0.5),
        actor("parked_0", 40.0, 2.0),  # 1.1 m beside the route
        actor("parked_1", 40.0, 2.4),
        actor("screen_0", 50.0, -2.0),
        actor("walker", 7.0, 0.0),  # before the bumper of the CAV
        actor("walker_2", 8.0, 0.0),
    )
    chosen = select_free_actors(roads, [straight()], everything)
    assert [one.id for one in chosen] == ["block", "parked_1", "walker_2"]


def test_an_obstacle_in_a_narrow_lane_stands_further_right_and_in_a_wide_one_where_it_was() -> None:
    for network in ("old_town", "wide_crossing"):
        roads = load(network)
        lane = max((one for one in roads.driving if not one.junction), key=lambda one: one.centre.length)
        s = lane.centre.length / 2
        (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
        there = actor("block", 0.0, 0.0).model_copy(update={"start": Pose(x=x, y=y, yaw=yaw)})
        moved = fit_to_lane_width(there, roads).start
        _, offset = lane.centre.project(moved.x, moved.y)
        assert offset == pytest.approx(-max(3.5 - lane.width, 0.0), abs=2e-3)
        assert moved.yaw == pytest.approx(yaw, abs=1e-4)


@pytest.mark.parametrize(
    ("bend", "station", "expected"), [(0.7, 15, True), (0.7, 40, False), (0.5, 15, False), (-0.7, 15, True)]
)
def test_an_obstacle_shortly_after_a_bend_leaves_no_room(bend: float, station: int, expected: bool) -> None:
    ego = straight(bend=bend)
    x, y = ego.xy[station].tolist()
    assert is_behind_bend(actor("block", x, y), ego) is expected
