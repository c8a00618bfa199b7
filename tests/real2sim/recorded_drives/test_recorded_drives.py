"""Synthetic recordings in the V2XPnP format: places of vehicles on the two maps, and which part of a drive is kept."""

import math
import random
from dataclasses import astuple
from types import MappingProxyType

import pytest
import shapely
from testing.worlds import straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import TICKS_PER_SECOND, Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, Recorder
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, ReplayMotion
from mdrive_sumo.worlds.places import draw_place, write_place
from mdrive_sumo.worlds.signalled_crossings import find_signalled_crossings
from real2sim.recorded_drives.record_drive import (
    APART_M,
    LATEST_START_S,
    MIN_DISTANCE_M,
    WARM_UP_S,
    WINDOW_S,
    RecordedDrive,
    build_cavs,
    find_window,
)
from real2sim.recorded_drives.recording_site import PLACES
from real2sim.recorded_drives.roadside_poses import compute_walking_pose, find_kerb_sides
from real2sim.recorded_drives.scripted_people import PopulationCounts, build_people

CROWD = PopulationCounts(walkers=12, waiting=4, crossing=12, cyclists=4, parked=14)


@pytest.fixture(scope="module", params=range(4))
def roads(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """A drawn place of each kind: a crossing and a street, with a parking lane and with a cycle lane."""
    kind, parameters = PLACES[request.param]
    return load_road_map(write_place(draw_place(kind, "test", **parameters), tmp_path_factory.mktemp("place")))


def crowd(roads: RoadMap, seed: int = 0) -> tuple[Actor, ...]:
    return build_people(roads, CROWD, 30.0, random.Random(seed))


def of(actors: tuple[Actor, ...], name: str) -> list[Actor]:
    return [actor for actor in actors if actor.id.startswith(name)]


def surface(roads: RoadMap) -> shapely.MultiPolygon:
    lanes = [shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat") for lane in roads.driving]
    return shapely.MultiPolygon(lanes)


def test_people_walk_on_pavements_and_others_keep_between_them_and_the_lanes(roads: RoadMap) -> None:
    pavement, road = shapely.MultiPolygon([shapely.Polygon(p).buffer(0) for p in roads.pavements]), surface(roads)
    sides = find_kerb_sides(roads)
    assert len(sides) >= 4
    for side in sides:
        middle = side.lane.centre.length / 2
        for pose in (compute_walking_pose(side, middle, aside) for aside in (-1.0, 0.0, 1.0)):
            assert pavement.distance(shapely.Point(pose.x, pose.y)) < 0.05
    actors = crowd(roads)
    for actor in of(actors, "parked"):
        assert min(area.distance(shapely.Point(actor.start.x, actor.start.y)) for area in (pavement, road)) > 0.9
    for actor in of(actors, "cyclist"):
        assert min(area.distance(shapely.Point(actor.start.x, actor.start.y)) for area in (pavement, road)) > 0.3


def test_there_are_as_many_people_as_asked_for(roads: RoadMap) -> None:
    actors = crowd(roads)
    counts = {name: len(of(actors, name)) for name in ("walker", "waiting", "crossing", "cyclist", "parked")}
    can_cycle = any(side.can_cycle for side in find_kerb_sides(roads))
    assert counts["cyclist"] == (CROWD.cyclists if can_cycle else 0)
    assert 0 < counts["parked"] <= CROWD.parked if roads.parking else counts["parked"] == 0
    assert (counts["waiting"], counts["crossing"]) == (CROWD.waiting, CROWD.crossing)
    assert sum(counts.values()) == sum(astuple(CROWD))
    assert crowd(roads) == actors
    assert crowd(roads, 1) != actors


def test_no_pedestrian_crosses_against_the_light(roads: RoadMap) -> None:
    for actor in of(crowd(roads), "crossing"):
        assert isinstance(actor.motion, ReplayMotion)
        (_, begin_s, _), stays = (pose[0] for pose in actor.motion.poses), actor.motion.stays
        assert stays
        way = shapely.LineString([pose[1:3] for pose in actor.motion.poses[1:]])
        (zebra,) = (
            zebra for zebra in find_signalled_crossings(roads) if shapely.LineString(zebra.line).distance(way) < 1.31
        )
        moment = begin_s % zebra.cycle_s if zebra.green else 0.0
        assert not zebra.green or any(begin <= moment < end for begin, end in zebra.green)


def test_walkers_keep_to_the_pavement_for_as_long_as_a_drive_may_last(roads: RoadMap) -> None:
    """Behind the end of its path an actor on foot walks straight on."""
    pavement = shapely.MultiPolygon([shapely.Polygon(p).buffer(0) for p in roads.pavements])
    for actor in of(crowd(roads), "walker"):
        assert isinstance(actor.motion, PathMotion)
        way = shapely.LineString(actor.motion.points)
        assert max(pavement.distance(shapely.Point(point)) for point in actor.motion.points) < 0.1
        assert way.length > (LATEST_START_S + WINDOW_S) * actor.motion.speed


def test_cyclists_ride_along_kerbs_without_parking(roads: RoadMap) -> None:
    actors = crowd(roads)
    parked = [shapely.Point(actor.start.x, actor.start.y) for actor in of(actors, "parked")]
    for actor in of(actors, "cyclist"):
        assert isinstance(actor.motion, PathMotion)
        way = shapely.LineString(actor.motion.points)
        assert min(map(way.distance, parked), default=9.0) > 1.5


def test_parked_vehicles_do_not_overlap(roads: RoadMap) -> None:
    parked = of(crowd(roads), "parked")
    for i, one in enumerate(parked):
        for other in parked[:i]:
            apart = math.hypot(one.start.x - other.start.x, one.start.y - other.start.y)
            assert apart > (one.length + other.length) / 2 or apart > 10.0


@pytest.mark.slow
def test_cavs_start_apart_on_one_axis_before_a_junction_and_many_turn(roads: RoadMap) -> None:
    turns = 0
    for seed in range(20):
        one, other = build_cavs(roads, 2, random.Random(seed))
        assert math.hypot(one.start.x - other.start.x, one.start.y - other.start.y) > APART_M
        assert abs(math.cos(one.start.yaw - other.start.yaw)) > 0.7
        for ego in (one, other):
            first = roads.lanes[ego.lanes[0]]
            assert first.successors
            assert roads.lanes[ego.lanes[1]].junction
            turns += abs(math.remainder(ego.route[-1][2] - ego.route[0][2], 2 * math.pi)) > 0.8
    assert 20 <= turns <= 38


def drive(*legs: tuple[float, float, float]) -> RecordedDrive:
    """A CAV that goes so many seconds at a speed [m/s] and yaw rate [rad/s]."""
    recorder, tick, x, y, yaw = Recorder("straight", {}, {"0": (4.9, 2.06)}), 0, 0.0, 0.0, 0.0
    for seconds, speed, rate in legs:
        for _ in range(round(seconds * TICKS_PER_SECOND)):
            frame = Frame(tick, {"0": EgoState(x, y, yaw, speed)}, Actors.empty(), MappingProxyType({}))
            recorder.add(frame, {"0": Control(0.0, 0.0, 0.0)}, {}, {})
            yaw += rate / TICKS_PER_SECOND
            x += speed * math.cos(yaw) / TICKS_PER_SECOND
            y += speed * math.sin(yaw) / TICKS_PER_SECOND
            tick += 1
    episode = recorder.finish([Ending("0", tick - 1, End.ARRIVED)])
    return RecordedDrive(straight_scenario(straight_ego("0")), straight_road(), episode)


def test_the_part_with_the_turn_is_kept() -> None:
    start, end = find_window(drive((16.0, 5.0, 0.0), (3.0, 5.0, 0.5), (10.0, 5.0, 0.0))) or (0.0, 0.0)
    assert end - start == WINDOW_S
    assert start <= 16.0
    assert end >= 19.0
    assert find_window(drive((30.0, 5.0, 0.0))) == (WARM_UP_S, WARM_UP_S + WINDOW_S)


def test_a_drive_without_a_part_in_which_the_cav_drives_is_of_no_use() -> None:
    slow = (MIN_DISTANCE_M - 1.0) / WINDOW_S
    assert find_window(drive((30.0, slow, 0.0))) is None
    assert find_window(drive((WARM_UP_S + WINDOW_S - 1.0, 5.0, 0.0))) is None
