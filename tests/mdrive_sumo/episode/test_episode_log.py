"""Recorded episodes as logs: every second tick of all road users, with ids, dimensions and the map."""

import math
from types import MappingProxyType

import numpy as np
import pytest
import shapely
from testing.busy_log import Crowd, Driven, drive
from testing.worlds import straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from real2sim.recording import ObjectCategory
from real2sim.writers.episode_recording import build_hd_map, record_episode

pytestmark = pytest.mark.slow

THINGS = {
    "bike": (Kind.CYCLIST, 1.8, 0.7, ObjectCategory.BICYCLE),
    "bus": (Kind.VEHICLE, 12.0, 2.5, ObjectCategory.BUS),
    "car": (Kind.VEHICLE, 4.5, 1.8, ObjectCategory.CAR),
    "cone": (Kind.STATIC, 0.4, 0.4, ObjectCategory.STATIC),
    "lorry": (Kind.VEHICLE, 8.0, 2.5, ObjectCategory.TRUCK),
    "van": (Kind.VEHICLE, 5.9, 2.0, ObjectCategory.VAN),
    "walker": (Kind.PEDESTRIAN, 0.5, 0.5, ObjectCategory.PEDESTRIAN),
}
TICKS = 40
ROADS = straight_road()


def scenario(*ids: str) -> Scenario:
    bus = Actor(id="bus", kind="vehicle", model="bus", length=12.0, width=2.5, start=Pose(x=0, y=9, yaw=0))
    post = RoadsideUnit(id="post", x=3.0, y=4.0)
    egos = tuple(straight_ego(name) for name in ids)
    return straight_scenario(*egos).model_copy(update={"actors": (bus,), "rsus": (post,)})


def episode(*last: int) -> EpisodeRecord:
    """CAVs "0", "1", ... that leave after these ticks, and one thing of each kind; the car comes at tick 10."""
    ids = [str(n) for n in range(len(last))]
    recorder = Recorder("straight", {}, dict.fromkeys(ids, (4.9, 2.06)))
    for tick in range(TICKS):
        egos = {ego: EgoState(tick * 0.5, 4.0 * n, 0.0, 10.0) for n, ego in enumerate(ids) if tick <= last[n]}
        names = [name for name in THINGS if name != "car" or tick >= 10]
        kind, length, width = (np.array([THINGS[name][k] for name in names]) for k in range(3))
        x = np.array([0.1 * tick if name != "cone" else 5.0 for name in names])
        y, yaw = np.linspace(10.0, 40.0, len(names)), np.full(len(names), 0.5)
        speed = np.array([2.0 if name != "cone" else 0.0 for name in names])
        actors = Actors(tuple(names), kind.astype(np.uint8), x, y, yaw, speed, length, width)
        controls = dict.fromkeys(egos, Control(0.0, 0.0, 0.0))
        recorder.add(Frame(tick, egos, actors, MappingProxyType({})), controls, {}, {})
    return recorder.finish([Ending(ego, tick, End.ARRIVED) for ego, tick in zip(ids, last, strict=True)])


def test_all_road_users_are_listed_at_ten_hertz_with_id_kind_and_dimensions() -> None:
    found = record_episode(episode(TICKS - 1), scenario("0"), ROADS)
    assert (found.id, found.dt_s, found.frame_count, found.cavs, found.notes) == ("straight", 0.1, 20, ("0",), ())
    whole, post = found.views
    assert (post.observer, post.is_infrastructure, post.pose.tolist()) == ("post", True, [[3.0, 4.0, 0.0]] * 20)
    tracks = {track.id: track for track in whole.tracks}
    assert {name: track.category for name, track in tracks.items()} == {
        "0": ObjectCategory.CAR,
        **{name: category for name, (*_, category) in THINGS.items()},
    }
    for name, (_, length, width, _) in THINGS.items():
        there = tracks[name].valid
        np.testing.assert_allclose(tracks[name].length[there], length)
        np.testing.assert_allclose(tracks[name].width[there], width)
        np.testing.assert_allclose(tracks[name].yaw[there], 0.5)
    np.testing.assert_allclose(tracks["0"].x, np.arange(20) * 1.0)
    assert tracks["car"].valid_frames.tolist() == list(range(5, 20))
    assert np.isnan(tracks["car"].x[:5]).all()
    assert {name for name, track in tracks.items() if track.parked} == {"cone"}


def test_a_log_ends_with_its_first_observer_unless_a_window_is_given() -> None:
    driven, asked = episode(TICKS - 1, 20), scenario("0", "1")
    found = record_episode(driven, asked, ROADS)
    assert (found.frame_count, found.cavs) == (11, ("0", "1"))
    later = record_episode(driven, asked, ROADS, (0.5, 1.5))
    assert (later.frame_count, later.cavs, later.notes) == (11, ("0",), ("CAV 1 is not there throughout",))
    assert later.views[0].tracks[0].x[0] == pytest.approx(5.0)
    with pytest.raises(InputError, match=r"straight: expected a window within its 2 s, found \(5.0, 6.0\)"):
        record_episode(driven, asked, ROADS, (5.0, 6.0))


def test_another_scenarios_episode_is_refused() -> None:
    with pytest.raises(InputError, match="expected an episode of scenario other"):
        record_episode(episode(20), scenario("0").model_copy(update={"id": "other"}), ROADS)
    with pytest.raises(InputError, match="expected an episode of scenario straight"):
        record_episode(episode(20), scenario("a"), ROADS)


@pytest.mark.parametrize("name", ["town_crossing", "boulevard", "minor_road"])
def test_the_map_is_that_of_the_network(name: str) -> None:
    roads = load_road_map(find_network_folder(name))
    found = build_hd_map(roads)
    assert found.lanes.keys() == roads.lanes.keys()
    for name, lane in found.lanes.items():
        real = roads.lanes[name]
        assert (lane.exits, lane.left_neighbour, lane.right_neighbour) == (real.successors, real.left, real.right)
        assert set(lane.entries) == {other.id for other in roads.driving if name in other.successors}
        assert (lane.width, lane.speed_limit, lane.junction) == (real.width, real.speed_limit, real.junction)
        assert np.hypot(*np.diff(lane.centre, axis=0).T).max() <= 0.5 + 1e-9
        line = shapely.LineString(real.centre.xy)
        assert shapely.hausdorff_distance(line, shapely.LineString(lane.centre)) < 1e-6
        for side, edge in ((1.0, lane.left), (-1.0, lane.right)):
            off = np.array([real.centre.project(*point) for point in edge[1:-1].tolist()])
            assert (np.sign(off[:, 1]) == side).all()
            assert np.abs(np.abs(off[:, 1]) - real.width / 2).max() < 0.1
    assert len(found.crosswalks) == len(roads.crossings)
    for polygon, (line, width) in zip(found.crosswalks, roads.crossings, strict=True):
        assert shapely.Polygon(polygon).area == pytest.approx(shapely.LineString(line).length * width, rel=0.01)
    held = {lane.id for lane in roads.driving if lane.lights}
    assert {lane for lanes in found.signals.values() for lane in lanes} == held


def test_stop_signs_are_stop_lines() -> None:
    roads = load_road_map(find_network_folder("minor_road"))
    (line,) = build_hd_map(roads).stop_lines
    assert roads.stop_signs is not None
    (sign,) = roads.stop_signs
    lane = roads.lanes[sign.lane]
    assert (line.lanes, line.sign) == ((lane.id,), "stop")
    assert math.dist(*line.line) == pytest.approx(lane.width)
    assert line.line.mean(axis=0) == pytest.approx(np.array(lane.centre.at(sign.line_pos_m)))


@pytest.fixture(scope="module")
def driven() -> Driven:
    return drive(0, Crowd(vehicles=12, walkers=4, all=20))


def test_an_episode_in_sumo_is_a_log_too(driven: Driven) -> None:
    found = record_episode(driven.episode, driven.scenario, driven.roads, (1.0, 5.0))
    tracks = {track.id: track for track in found.views[0].tracks}
    assert len(tracks) > 8
    assert found.cavs == ("0", "1")
    for column, name in enumerate(driven.episode.ids):
        there = driven.episode.valid[20:101:2, column]
        if there.any():
            np.testing.assert_array_equal(tracks[name].valid, there)
            np.testing.assert_array_equal(tracks[name].x[there], driven.episode.x[20:101:2, column][there])
            np.testing.assert_array_equal(tracks[name].yaw[there], driven.episode.yaw[20:101:2, column][there])
    moved = np.hypot(*np.diff(tracks["0"].xy, axis=0).T) / 0.1
    np.testing.assert_allclose(moved, driven.episode.speed[21:101:2, 0], atol=0.5)
