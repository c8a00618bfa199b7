"""Streams: groups that keep their course beside a chain of lanes, each member due in its time."""

import numpy as np
import pytest

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.hard_places import PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, find_junction_ways
from mdrive_sumo.generate.hard.streams import RoadUserStream, build_stream
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.worlds.placement.lane_chains import build_route_line, compute_pose


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    choice = PlaceChoice("crossing", {"area": "town", "arms": 4, "control": "priority"})
    place = draw_hard_place(PlaceTask(choice, "streams", tmp_path_factory.mktemp("places")))
    assert place is not None
    return place.load_roads()


@pytest.fixture(scope="module")
def way(roads: RoadMap) -> JunctionWay:
    return max(
        (way for way in find_junction_ways(roads) if way.turn == "straight"), key=lambda way: (way.stop_m, way.lanes)
    )


def make_stream(way: JunctionWay, **changes: float) -> RoadUserStream:
    fixed = {"offset_m": 1.8, "speed": 12.0, "first_s": 2.0, "headway_s": 0.9, "count": 5, "pause_s": 6.0}
    return RoadUserStream(way.lanes, way.stop_m, model="motorcycle", **{**fixed, **changes})  # type: ignore[arg-type]


def list_poses(actor: Actor) -> np.ndarray:
    assert isinstance(actor.motion, ReplayMotion)
    return np.array(actor.motion.poses)


def find_time_nearest(actor: Actor, x: float, y: float) -> float:
    poses = list_poses(actor)
    times = np.arange(poses[0, 0], poses[-1, 0], 0.01)
    away = np.hypot(np.interp(times, poses[:, 0], poses[:, 1]) - x, np.interp(times, poses[:, 0], poses[:, 2]) - y)
    return float(times[away.argmin()])


def test_members_are_due_with_their_headway_and_groups_with_a_pause(roads: RoadMap, way: JunctionWay) -> None:
    stream = make_stream(way)
    actors = build_stream(roads, "rider", stream)
    met = compute_pose(roads, way.lanes, way.stop_m, 1.8)
    due_s = [find_time_nearest(actor, met.x, met.y) for actor in actors]
    assert [actor.id for actor in actors] == [f"rider{k}" for k in range(10)]
    assert due_s == pytest.approx([2.0, 2.9, 3.8, 4.7, 5.6, 11.6, 12.5, 13.4, 14.3, 15.2], abs=0.05)
    assert due_s == pytest.approx(stream.list_due_s(), abs=0.05)
    assert not any(actor.avoid_collision for actor in actors)


@pytest.mark.parametrize("offset_m", [1.8, -2.5])
def test_members_keep_their_distance_from_the_lanes_and_their_speed(
    roads: RoadMap, way: JunctionWay, offset_m: float
) -> None:
    curve = build_route_line(roads, way.lanes).curve
    for actor in build_stream(roads, "rider", make_stream(way, offset_m=offset_m)):
        poses = list_poses(actor)
        assert [curve.project(x, y)[1] for _, x, y, _ in poses] == pytest.approx([offset_m] * len(poses), abs=0.05)
        steps = np.hypot(np.diff(poses[:, 1]), np.diff(poses[:, 2])) / np.diff(poses[:, 0])
        assert steps == pytest.approx(12.0, abs=0.1)


def test_a_stream_that_flows_at_the_start_lacks_those_who_have_left(roads: RoadMap, way: JunctionWay) -> None:
    actors = build_stream(roads, "rider", make_stream(way, first_s=-30.0, groups=1, count=40, beyond_m=24.0))
    met = compute_pose(roads, way.lanes, way.stop_m, 1.8)
    poses = [list_poses(actor) for actor in actors]
    assert all(one[0, 0] == 0.0 for one in poses[:3])
    assert [find_time_nearest(actor, met.x, met.y) for actor in actors][-1] == pytest.approx(5.1, abs=0.05)
    assert len(actors) == sum(
        due_s > -1.0 for due_s in make_stream(way, first_s=-30.0, count=40, groups=1).list_due_s()
    )


def test_later_members_appear_where_the_stream_begins(roads: RoadMap, way: JunctionWay) -> None:
    actors = build_stream(roads, "rider", make_stream(way, begin_m=way.stop_m - 60.0))
    begin = compute_pose(roads, way.lanes, way.stop_m - 60.0, 1.8)
    last = actors[-1]
    assert (last.start.x, last.start.y) == pytest.approx((begin.x, begin.y), abs=0.01)
    assert list_poses(last)[0, 0] == pytest.approx(15.2 - 5.0, abs=0.05)
