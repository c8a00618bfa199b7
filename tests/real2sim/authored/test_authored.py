"""Authored scenes on their networks: offsets, lanes of those that pace, starts, maps, all or nothing."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.made_up_town import ROAD
from testing.map_faults import lane, lanes_map
from testing.mdrive_directory import TIMED, WALK, Directory, xml
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    LaneMotion,
    PathMotion,
    PositionTrigger,
    ReplayMotion,
)
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite
from real2sim.authored.suite_converter import convert_authored
from real2sim.readers.carla_frame import UCLA_FRAME
from real2sim.readers.mdrive import VectorMap, find_mdrive_folders, read_mdrive
from real2sim.source_scene import SourceScene

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

ABOUT = SuiteFile(name="made-up", title="Made up")


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path)


def convert(out: Path, *scenes: SourceScene) -> Suite:
    convert_authored(scenes, out, ABOUT, ["A note."])
    return load_suite(str(out))


def one(directory: Directory, out: Path) -> tuple[Scenario, Float]:
    """The scenario, and the offset of its network."""
    (scenario,) = convert(out, directory.read()).scenarios
    return scenario, np.array(read_network_file(out / "networks" / "TownXX").offset)


def test_everything_moves_by_the_networks_offset(directory: Directory, tmp_path: Path) -> None:
    directory.add("static", "a.xml", xml([(150, 5, 90)]), name="a")
    directory.add("pedestrian", "b.xml", WALK, name="b")
    directory.add("npc", "c.xml", xml(TIMED), name="c")
    (directory.towns / "TownXX.xodr").write_text(ROAD.replace('x="0" y="0"', 'x="-30" y="-0.4"'))
    scene = directory.read()
    there = PositionTrigger(vehicle="0", x=30, y=-1.75)
    changed = [actor.model_copy(update={"trigger": there}) if actor.id == "b" else actor for actor in scene.actors]
    (scenario,) = convert(tmp_path / "out", replace(scene, actors=tuple(changed))).scenarios
    dx, dy = read_network_file(tmp_path / "out" / "networks" / "TownXX").offset
    assert (dx, dy) == pytest.approx((30, 0.4))
    actors = {actor.id: actor for actor in scenario.actors}
    start = actors["a"].start
    assert (start.x, start.y, start.yaw) == pytest.approx((150 + dx, -5 + dy, -math.pi / 2))
    assert isinstance(actors["b"].motion, PathMotion)
    assert actors["b"].motion.points[1] == pytest.approx((60 + dx, 6 + dy))
    assert isinstance(actors["c"].motion, ReplayMotion)
    assert actors["c"].motion.poses[0] == pytest.approx((0.5, 60 + dx, -1.75 + dy, 0))
    assert actors["b"].trigger == PositionTrigger(vehicle="0", x=30 + dx, y=-1.75 + dy)
    ego = scenario.egos[1]
    assert (ego.id, ego.start.x, ego.start.y) == ("1", pytest.approx(40 + dx), pytest.approx(-2.15 + dy)), (
        "CAVs on their lane"
    )


def test_a_pacing_actor_follows_its_lanes_and_beyond_its_path(directory: Directory, tmp_path: Path) -> None:
    path = xml([(60, 5.25, 0), (90, 5.4, 0)])
    for name, action in (("a", {"type": "hard_brake"}), ("b", {"type": "hard_brake", "pacing": False})):
        directory.add("npc", f"{name}.xml", path, name=name, speed=7)
        directory.behave(name, action)
    scenario, _ = one(directory, tmp_path / "out")
    pacing = next(actor.motion for actor in scenario.actors if actor.id == "a")
    others = next(actor.motion for actor in scenario.actors if actor.id == "b")
    assert isinstance(pacing, LaneMotion)
    assert isinstance(others, PathMotion)
    roads = load_road_map(tmp_path / "out" / "networks" / "TownXX")
    assert [roads.lanes[name].right for name in pacing.lanes] == [""], "the outer lane"
    assert pacing.speed == 7


def test_a_pacing_actor_off_the_lanes_keeps_to_its_path_with_a_note(directory: Directory, tmp_path: Path) -> None:
    directory.add("npc", "a.xml", xml([(60, 9, 0), (90, 9, 0)]), name="a")
    directory.behave("a", {"type": "lane_change"})
    scenario, _ = one(directory, tmp_path / "out")
    assert isinstance(scenario.actors[0].motion, PathMotion)
    assert scenario.notes == ("a: no lanes within 1 m along its path, which it follows instead",)
    report = json.loads((tmp_path / "out" / "conversion.json").read_text())
    assert report["scenario_notes"] == {"Category_7": list(scenario.notes)}
    assert "| Category_7 | a: no lanes within 1 m" in (tmp_path / "out" / "conversion.md").read_text()


def test_lanes_go_straightest_on(tmp_path: Path) -> None:
    """Behind the end of its path an actor's lanes go on, at the fork not to the side."""
    east = lane("e", UCLA_FRAME.to_map_xy(np.array([(0, 0), (60, 0)])), exits=("on", "off"))
    on, off = (
        lane("on", UCLA_FRAME.to_map_xy(np.array([(60, 0), (160, 0)]))),
        lane("off", UCLA_FRAME.to_map_xy(np.array([(60, 0), (70, -2), (80, -10), (85, -25), (85, -60)]))),
    )
    directory = Directory(tmp_path)
    directory.add("npc", "a.xml", xml([(20, 0, 0), (40, 0, 0)]), name="a")
    directory.behave("a", {"type": "lane_change"})
    for name, x in (("x_vehicle_1_0.xml", 5), ("x_vehicle_2_1.xml", 45)):
        (directory.folder / name).write_text(xml([(x, 0, 0), (150, 0, 0)]))
    (scenario,) = convert(
        tmp_path / "out", read_mdrive(directory.write(), VectorMap(lanes_map(east, on, off)))
    ).scenarios
    motion = scenario.actors[0].motion
    assert isinstance(motion, LaneMotion)
    roads = load_road_map(tmp_path / "out" / "networks" / "7")
    end = roads.lanes[motion.lanes[-1]].centre
    assert end.at(end.length) == pytest.approx((662.5, -201), abs=0.1)


def test_an_actor_in_a_cav_is_noted(directory: Directory, tmp_path: Path) -> None:
    directory.add("static", "a.xml", xml([(22, 1.75, 0)]), name="a")
    directory.add("npc", "b.xml", xml([(40, 1.75, 0, 0.0), (60, 1.75, 0, 1.0)]), name="b")
    directory.add("npc", "c.xml", xml([(40, 1.75, 0, 0.1), (60, 1.75, 0, 1.0)]), name="c")
    scenario, _ = one(directory, tmp_path / "out")
    assert set(scenario.notes) == {"a overlaps CAV 0 at the start", "b overlaps CAV 1 at the start"}


def test_an_actor_that_no_cav_triggers_is_noted(directory: Directory, tmp_path: Path) -> None:
    for name, y in (("a", 18), ("b", 9), ("c", 30)):
        directory.add("pedestrian", f"{name}.xml", xml([(60, y, 0), (60, -6, 0)]), name=name)
    directory.behave("a", None, distance_m=10)
    directory.behave("b", None, distance_m=10)
    directory.behave("c", {"type": "hard_brake", "pacing": False})
    scenario, _ = one(directory, tmp_path / "out")
    note = "a never moves: the route of CAV 0 comes no nearer than 16.2 m, its trigger is at 10 m"
    assert scenario.notes == (note,), "c moves from the beginning"


def test_a_town_is_built_once_and_reported(directory: Directory, tmp_path: Path) -> None:
    scene = directory.read()
    suite = convert(tmp_path / "out", scene, replace(scene, id="again"))
    assert [s.network for s in suite.scenarios] == ["TownXX", "TownXX"]
    assert [path.name for path in (tmp_path / "out" / "networks").iterdir()] == ["TownXX"]
    assert suite.about.description == "A note. Stop signs: signs unknown for TownXX."
    report = json.loads((tmp_path / "out" / "conversion.json").read_text())
    assert (report["waypoints"], len(report["towns"])) == (8, 1)


def test_scenarios_of_one_vector_map_share_a_network_directed_by_their_motion(tmp_path: Path) -> None:
    """The map does not tell the direction of its lane; the logged vehicles do."""
    directory = Directory(tmp_path)
    directory.add("npc", "a.xml", xml([(x, 0, 0, x / 10) for x in range(0, 180, 1)]), name="a")
    for name, x in (("x_vehicle_1_0.xml", 5), ("x_vehicle_2_1.xml", 45)):
        (directory.folder / name).write_text(xml([(x, 0, 0), (150, 0, 0)]))
    west = lane("w", [(702.5, -201), (602.5, -201), (502.5, -201)], directed=False)
    scene = read_mdrive(directory.write(), VectorMap(lanes_map(west)))
    suite = convert(tmp_path / "out", scene, replace(scene, id="again"))
    assert [scenario.network for scenario in suite.scenarios] == ["7", "7"]
    (ego, _) = suite.scenarios[0].egos
    assert (ego.start.x, ego.start.y) == pytest.approx((507.5, -201), abs=0.05)
    assert ego.start.yaw == pytest.approx(0, abs=0.01)
    assert isinstance(suite.scenarios[0].actors[0].motion, ReplayMotion)


def test_a_trigger_on_an_unknown_vehicle_is_refused(directory: Directory, tmp_path: Path) -> None:
    directory.add("pedestrian", "a.xml", WALK, name="a")
    scene = directory.read()
    trigger = DistanceTrigger(vehicle="9")
    ghost: Actor = scene.actors[0].model_copy(update={"trigger": trigger})
    with pytest.raises(InputError, match=r"Category_7: .*expected one of the CAVs 0, 1, found '9'"):
        convert(tmp_path / "out", replace(scene, actors=(ghost,)))


def test_nothing_is_left_of_a_conversion_that_fails(directory: Directory, tmp_path: Path) -> None:
    scene = directory.read()
    lost = replace(scene, id="lost", routes=(replace(scene.routes[0], waypoints=np.array([(0, 900), (9, 900)])),))
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match="lost: CAV 0: expected at least 2 waypoints within 12 m of a lane, found 0"):
        convert(tmp_path / "out", scene, lost)
    assert sorted(tmp_path.iterdir()) == before


def test_scenarios_must_differ_in_name_and_be_there(directory: Directory, tmp_path: Path) -> None:
    scene = directory.read()
    with pytest.raises(InputError, match="different names, found Category_7 twice"):
        convert(tmp_path / "out", scene, scene)
    with pytest.raises(InputError, match="found none"):
        convert(tmp_path / "out")


def test_an_unknown_town_is_refused(directory: Directory, tmp_path: Path) -> None:
    directory.add("static", "a.xml", xml([(22, 1.75, 0)]))
    for file in directory.folder.glob("x_*.xml"):
        file.write_text(file.read_text().replace("TownXX", "Town99"))
    with pytest.raises(InputError, match=r"expected Town99\.xodr or Town99\.net\.xml, found neither"):
        convert(tmp_path / "out", directory.read())


def test_a_whole_folder_takes_the_place_of_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with atomic_folder(tmp_path / "out") as draft:
        (draft / "a").write_text("a")
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.rglob("*"))] == ["out", "out/a"]


@pytest.mark.parametrize("error", [InputError("broken"), KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_nothing_is_left_of_a_folder_that_fails(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises((InputError, KeyboardInterrupt)) as caught, atomic_folder(tmp_path / "out") as draft:
        (draft / "a").write_text("a")
        raise error
    assert not list(tmp_path.iterdir())
    if isinstance(error, OSError):
        assert str(caught.value) == f"{tmp_path / 'out'}: cannot be written: No space left on device"


@pytest.mark.parametrize("there", ["a file", "a folder with something in it", "a link"])
def test_what_is_there_is_not_written_over(tmp_path: Path, there: str) -> None:
    out = tmp_path / "out"
    if there == "a file":
        out.write_text("mine")
    elif there == "a link":
        out.symlink_to(tmp_path / "nowhere")
    else:
        (out / "mine").mkdir(parents=True)
    with pytest.raises(InputError, match="new or empty folder"), atomic_folder(out):
        pytest.fail("the block must not run")


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Suite:
    out = tmp_path_factory.mktemp("real") / "out"
    towns = SHARED_DATA / "carla_towns"
    folders = find_mdrive_folders([SHARED_DATA / "mdrive" / "interaction"])
    return convert(out, *(read_mdrive(folder, towns) for folder in folders))


@needs_data
@pytest.mark.full  # in `make test`: made-up directories with the same parts, above
def test_the_real_directories_lie_on_their_towns(real: Suite) -> None:
    report = json.loads((real.folder / "conversion.json").read_text())
    assert (report["left_out"], report["shifts"]) == ([], [])
    assert len(report["off_lane"]) == 4, "all of CAV 0 in the roundabout, whose lanes SUMO draws straighter"
    assert {off["point"]["scenario"] for off in report["off_lane"]} == {"Roundabout_Navigation_1"}
    scenarios = {scenario.id: scenario for scenario in real.scenarios}
    lengths = {id_: [round(len(ego.route), -1) for ego in s.egos] for id_, s in scenarios.items()}
    assert lengths == {
        "Construction_Zone_10": [90, 70],
        "Pedestrian_Crosswalk_8": [100, 100, 110, 100],
        "Roundabout_Navigation_1": [80, 150],
        "precrash_L": [20, 40],
    }
    roads = load_road_map(real.folder / "networks" / "Town02")
    (npc,) = scenarios["precrash_L"].actors
    assert isinstance(npc.motion, PathMotion)
    found = roads.find_nearest_lanes(np.array(npc.motion.points))
    assert float(found.distance.max()) < 0.2, "the NPC drives on a lane"


@needs_data
@pytest.mark.full  # in `make test`: made-up directories with the same parts, above
def test_two_of_the_real_pedestrians_wait_for_ever(real: Suite) -> None:
    """CAVs 0 and 2 pass them at 15 m in the files already, 8 m would set them off."""
    notes = {scenario.id: scenario.notes for scenario in real.scenarios}
    assert [note[:21] for note in notes["Pedestrian_Crosswalk_8"]] == ["entity_1 never moves:", "entity_3 never moves:"]


@needs_data
@pytest.mark.full  # in `make test`: made-up directories with the same parts, above
def test_the_roundabout_needs_a_one_sided_link(real: Suite) -> None:
    towns = json.loads((real.folder / "conversion.json").read_text())["towns"]
    assert {town["name"]: len(town["repairs"]) for town in towns} == {"Town02": 0, "Town03": 1, "Town05": 0}
