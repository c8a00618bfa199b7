"""MDrive scenario directories: made-up files for each rule of protocol section 3, and the real directories."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from testing.mdrive_directory import TIMED, WALK, Directory, Waypoint, xml
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scripted_actor import (
    DistanceTrigger,
    HardBrake,
    PathMotion,
    ReplayMotion,
    StandingMotion,
    StartMotion,
)
from real2sim.hd_map import HdMap
from real2sim.readers.carla_frame import UCLA_FRAME, CarlaFrame
from real2sim.readers.mdrive import VectorMap, find_mdrive_folders, find_nearest_weather, read_mdrive
from real2sim.readers.mdrive_actors import find_blueprint_shape
from real2sim.source_scene import TownMap

REAL = SHARED_DATA / "mdrive" / "interaction"


def test_cavs_are_the_manifests_and_y_and_yaw_are_flipped(directory: Directory) -> None:
    (directory.folder / "left_over_2.xml").write_text("not even XML")
    (directory.folder / "x_vehicle_1_0_REPLAY.xml").write_text(xml([(21, 1.75, 0, 0), (90, 1.75, 0, 5)]))
    directory.add("static", "cone.xml", xml([(50, 5.0, 90)]), model="static.prop.constructioncone")
    scene = directory.read()
    assert [(route.id, route.waypoints.tolist()) for route in scene.routes] == [
        ("0", [[20, -1.75], [90, -1.75]]),
        ("1", [[40, -1.75], [90, -1.75]]),
    ]
    assert (scene.id, scene.bucket, scene.category) == ("Category_7", "Interaction", "Category")
    assert scene.map == TownMap("TownXX", directory.towns)
    start = scene.actors[0].start
    assert (start.x, start.y, start.yaw) == (50.0, -5.0, pytest.approx(-math.pi / 2))
    assert scene.notes == ("CAV 0: its logged motion x_vehicle_1_0_REPLAY.xml is not driven",)


def test_without_cavs_in_the_manifest_every_numbered_file_is_one(directory: Directory) -> None:
    directory.manifest["ego"] = []
    (directory.folder / "x_vehicle_1_0_REPLAY.xml").write_text("not read")
    (directory.folder / ".x_vehicle_1_0.xml").write_text("not read")
    (directory.folder / "x_vehicle_1_0_REPLAY.xml").write_text(xml([(20, 1.75, 0, 0), (90, 1.75, 0, 5)]))
    assert [route.id for route in directory.read().routes] == ["0", "1"]


def test_a_route_of_another_place_gives_way_to_the_logged_motion(directory: Directory) -> None:
    logged = [(100 + step, 1.75, 0, step / 10) for step in range(41)]
    (directory.folder / "x_vehicle_1_0_REPLAY.xml").write_text(xml(logged))
    scene = directory.read()
    assert scene.routes[0].waypoints[:, 0].tolist() == [100, 108, 116, 124, 132, 140]
    assert "begins 80.0 m from there" in scene.notes[0]


@pytest.mark.parametrize(
    ("key", "kind", "speed"),
    [
        ("npc", "vehicle", 8.0),
        ("pedestrian", "pedestrian", 1.5),
        ("walker", "pedestrian", 1.5),
        ("bicycle", "cyclist", 4.0),
        ("cyclist", "cyclist", 4.0),
        ("bike", "cyclist", 4.0),
    ],
)
def test_every_key_of_the_manifest_has_its_kind_and_speed(
    directory: Directory, key: str, kind: str, speed: float
) -> None:
    directory.add(key, "one.xml", WALK, name="one")
    actor = directory.actor()
    assert isinstance(actor.motion, PathMotion)
    assert (actor.id, actor.kind, actor.motion.speed, actor.trigger) == ("one", kind, speed, None)
    assert actor.motion.points == ((60, -8), (60, 6))
    assert actor.start.yaw == pytest.approx(math.pi / 2)


def test_the_manifests_speed_goes_before_the_files(directory: Directory) -> None:
    directory.add("npc", "one.xml", xml([(60, 1.75, 0), (90, 1.75, 0)], speed="6.5"), name="one", speed=3.25)
    directory.add("npc", "two.xml", xml([(60, 5.25, 0), (90, 5.25, 0)], speed="6.5"), name="two")
    speeds = [actor.motion.speed for actor in directory.read().actors if isinstance(actor.motion, PathMotion)]
    assert speeds == [3.25, 6.5]


@pytest.mark.parametrize("key", ["static", "static_prop"])
def test_props_stand_and_parked_vehicles_are_vehicles(directory: Directory, key: str) -> None:
    directory.add(key, "a.xml", xml([(60, 1.75, 0)]), name="cone", model="static.prop.trafficcone01")
    directory.add(key, "b.xml", xml([(70, 1.75, 0)], model="vehicle.tesla.model3"), name="parked")
    directory.add(key, "c.xml", xml([(80, 1.75, 0)]), name="bike", model="vehicle.bh.crossbike")
    cone, parked, bike = directory.read().actors
    assert (cone.kind, cone.length, cone.width) == ("static", 0.4, 0.4)
    assert (parked.kind, parked.length, parked.width) == ("vehicle", 4.7, 1.9)
    assert (bike.kind, bike.length, bike.width) == ("vehicle", 1.75, 0.6)
    assert all(actor.motion == StandingMotion() for actor in (cone, parked, bike))


def test_a_files_own_size_wins(directory: Directory) -> None:
    point = [(60, 1.75, 0)]
    directory.add("static", "a.xml", xml(point, bbox_length="2.2", bbox_width="0.4"), name="a")
    directory.add("static", "b.xml", xml(point, bbox_length="2.2"), name="b", length=3, width=1)
    directory.add("static", "c.xml", xml(point, length="4", width="2"), name="c", length=3, width=1)
    directory.add("static", "d.xml", xml(point), name="d")
    sizes = [(actor.length, actor.width) for actor in directory.read().actors]
    assert sizes == [(2.2, 0.4), (3, 1), (4, 2), (0.8, 0.8)]


def test_what_is_asked_for_and_not_done_is_noted(directory: Directory) -> None:
    speeds = WALK.replace('yaw="-90"', 'yaw="-90" speed="3"')
    directory.add("npc", "a.xml", speeds, name="a")
    directory.add("static", "b.xml", xml([(60, 1, 0)], snap_to_road="True"), name="b")
    directory.add("static", "c.xml", xml([(70, 1, 0)], snap_to_road="false"), name="c")
    assert directory.read().notes == (
        "a: speeds at its points are not read, it drives at 8 m/s",
        "b: is not moved onto the road (snap_to_road), but is where its file says",
    )


def test_avoid_collision_is_honoured(directory: Directory) -> None:
    directory.add("npc", "a.xml", WALK, name="a", avoid_collision=False)
    directory.add("npc", "b.xml", WALK, name="b", avoid_collision=True)
    directory.add("npc", "c.xml", WALK, name="c")
    assert [actor.avoid_collision for actor in directory.read().actors] == [False, True, True]


def test_entries_of_another_route_or_town_are_skipped(directory: Directory) -> None:
    directory.add("npc", "a.xml", WALK, name="a", route_id="6")
    directory.add("npc", "b.xml", WALK, name="b", town="Town99")
    directory.add("npc", "c.xml", WALK, name="c", town="TownXX")
    scene = directory.read()
    assert [actor.id for actor in scene.actors] == ["c"]
    assert [note.split(" is ")[0] for note in scene.notes] == ["a", "b"]


def test_names_become_ids_of_their_own(directory: Directory) -> None:
    for file, name in (("a.xml", "the cone!"), ("b.xml", "the cone?"), ("c.xml", "0"), ("d.xml", "_x")):
        directory.add("static", file, xml([(60, 1.75, 0)]), name=name)
    assert [actor.id for actor in directory.read().actors] == ["the_cone_", "the_cone_.2", "0.2", "a_x"]


def test_times_on_all_points_make_a_replay(directory: Directory) -> None:
    directory.add("npc", "a.xml", xml(TIMED), name="a")
    motion = directory.actor().motion
    assert isinstance(motion, ReplayMotion)
    assert motion.poses[0] == (0.5, 60, -1.75, 0)
    assert motion.poses[2] == (0.7, 64, -1.75, pytest.approx(math.radians(10)))
    assert not motion.stays


@pytest.mark.parametrize(
    ("points", "entry", "attributes", "replayed"),
    [
        (TIMED, {"control_mode": "policy"}, {}, False),
        (TIMED, {"control_mode": "policy"}, {"control_mode": "replay"}, True),
        (TIMED, {"control_mode": "replay"}, {"control_mode": "policy"}, False),
        ([*TIMED, (66, 1.75, 0)], {}, {}, False),
    ],
)
def test_the_routes_control_mode_goes_before_the_manifests(
    directory: Directory,
    points: Sequence[Waypoint],
    entry: Mapping[str, object],
    attributes: Mapping[str, str],
    replayed: bool,
) -> None:
    directory.add("npc", "a.xml", xml(points, **attributes), name="a", **entry)
    assert isinstance(directory.actor().motion, ReplayMotion if replayed else PathMotion)


@pytest.mark.parametrize(
    ("numbers", "name"),
    [
        ({}, "default"),
        ({"sun_altitude_angle": -15, "cloudiness": 20}, "night"),
        ({"sun_altitude_angle": 20, "cloudiness": 100, "precipitation": 15, "fog_density": 18}, "cloudy"),
        ({"cloudiness": 100, "precipitation": 60}, "rain"),
        ({"cloudiness": 30, "fog_density": 40}, "default"),
    ],
)
def test_the_weather_is_the_nearest(numbers: Mapping[str, float], name: str) -> None:
    found, note = find_nearest_weather(numbers)
    assert found == name
    assert bool(note) == bool(numbers), "what is lost is noted"


def test_the_weather_is_that_of_the_first_cav(directory: Directory) -> None:
    (directory.folder / "x_vehicle_1_0.xml").write_text(
        xml([(20, 1.75, 0), (90, 1.75, 0)], '<weather id="n" sun_altitude_angle="-15" cloudiness="20"/>')
    )
    scene = directory.read()
    assert scene.weather == "night"
    assert "sun altitude -15 deg" in scene.notes[0]


@pytest.mark.parametrize(
    ("model", "kind", "length"),
    [
        ("vehicle.lincoln.mkz2017", "vehicle", 4.7),
        ("vehicle.lincoln.mkz_2017", "vehicle", 4.7),
        ("vehicle.carlamotors.firetruck", "vehicle", 8.5),
        ("vehicle.mercedes.sprinter", "vehicle", 5.9),
        ("vehicle.diamondback.century", "cyclist", 1.75),
        ("vehicle.harley-davidson.low_rider", "vehicle", 2.2),
        ("walker.pedestrian.0001", "pedestrian", 0.5),
        ("static.prop.streetbarrier", "static", 2.0),
        ("static.prop.box01", "static", 1.2),
        ("static.prop.what_is_it", "static", 0.8),
    ],
)
def test_blueprints_have_the_size_of_their_class(model: str, kind: str, length: float) -> None:
    shape = find_blueprint_shape(model)
    assert shape is not None
    assert (shape.kind, shape.length) == (kind, length)


def test_a_name_of_no_blueprint_has_no_class() -> None:
    assert find_blueprint_shape("Car") is None


def test_carlas_frame_lies_where_mdrive_says_in_the_frame_of_v2xpnp() -> None:
    log = UCLA_FRAME.to_map_xy(np.array([(-114.6, 20.0)]))
    assert log[0].tolist() == pytest.approx([-114.6 + 502.5, -20.0 - 201.0])
    assert UCLA_FRAME.to_map_yaw(30.0) == pytest.approx(-math.radians(30.0))
    quarter = CarlaFrame(1.0, 2.0, math.pi / 2)
    assert quarter.to_map_xy(np.array([(10.0, -5.0)]))[0].tolist() == pytest.approx([1 - 5, 2 + 10])
    assert quarter.to_map_yaw(90.0) == pytest.approx(0.0)


def test_a_vector_map_has_its_scenarios_in_its_own_frame(directory: Directory) -> None:
    directory.add("npc", "a.xml", xml(TIMED), name="a")
    scene = read_mdrive(directory.write(), VectorMap(HdMap()))
    assert scene.routes[0].waypoints[0].tolist() == [522.5, -202.75]
    assert (scene.actors[0].start.x, scene.actors[0].start.y) == (562.5, -202.75)
    assert (scene.id, scene.bucket, scene.category) == ("7", "V2XPnP", "real2sim")
    assert isinstance(scene.map, HdMap)


def test_directories_are_found_below_a_folder(directory: Directory, tmp_path: Path) -> None:
    folder = directory.write()
    assert find_mdrive_folders([folder]) == find_mdrive_folders([tmp_path]) == (folder,)
    with pytest.raises(InputError, match=r"towns: expected a directory with actors_manifest\.json"):
        find_mdrive_folders([directory.towns])


@needs_data
def test_the_real_directories_are_read_whole() -> None:
    scenes = {scene.id: scene for scene in (read_mdrive(folder, SHARED_DATA) for folder in find_mdrive_folders([REAL]))}
    assert {id_: (len(s.routes), len(s.actors), s.weather) for id_, s in scenes.items()} == {
        "Construction_Zone_10": (2, 5, "default"),
        "Pedestrian_Crosswalk_8": (4, 3, "default"),
        "Roundabout_Navigation_1": (2, 0, "cloudy"),
        "precrash_L": (2, 1, "default"),
    }
    (npc,) = scenes["precrash_L"].actors
    assert npc.trigger == DistanceTrigger(vehicle="1", distance_m=6.0), "Vehicle 2 is ego 1, whatever its name"
    assert npc.action == HardBrake(hold_s=2.0, resume_speed=5.0, pacing=False, least_driven_m=3.0)
    assert isinstance(npc.motion, PathMotion)
    assert npc.motion.speed == 1.0
    walkers = scenes["Pedestrian_Crosswalk_8"].actors
    assert [actor.referenced_cav_ids for actor in walkers] == [("0",), ("1",), ("2",)]
    assert all(actor.action == StartMotion() for actor in walkers)
    sizes = {actor.id: (actor.kind, actor.length, actor.width) for actor in scenes["Construction_Zone_10"].actors}
    assert sizes["entity_1_1"] == ("static", 0.45, 0.45)
    assert sizes["entity_2_1"] == ("static", 2.0, 0.45)
