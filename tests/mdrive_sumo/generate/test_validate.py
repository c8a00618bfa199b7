"""One scenario at a time: room at the start, what is demanded by bucket; and the command with its exit codes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.generate.validation import (
    ScenarioValidation,
    ValidationTask,
    validate_scenario,
)
from mdrive_sumo.generate.validation.requirements import find_unmet_requirements
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundMode, BackgroundVehicle
from mdrive_sumo.scenario.reference_times import REFERENCE_TIMES_FILE, find_reference_times, save_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, TimeTrigger
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, SuiteFile, load_suite, save_suite, seal_suite
from mdrive_sumo.scoring import ScenarioResult, make_void_result
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE, OcclusionCertificate, OcclusionCertificateFile

pytestmark = pytest.mark.usefixtures("in_process")


@cache
def ours(name: str) -> Scenario:
    return next(s for s in load_suite("interdrive@0").scenarios if s.id == name)


@cache
def town() -> RoadMap:
    return load_road_map(find_network_folder("town_crossing"))


TOWN = "i07_ins_ss_town"
FURTHER = Pose(x=-14.5, y=-1.75, yaw=0.0)
"""12 m ahead of its first CAV, on the lane."""


def result(ds: float = 100.0, rc: float = 100.0, min_ttc: float | None = 0.5) -> ScenarioResult:
    return make_void_result(ours(TOWN), 0, "").model_copy(update={"ds": ds, "rc": rc, "min_ttc": min_ttc})


@pytest.mark.parametrize("bucket", ["InterDrive", "Interaction", "of_my_own"])
def test_what_was_made_is_difficult_and_solved_without_an_infraction(bucket: str) -> None:
    assert find_unmet_requirements(bucket, result(), result()) == ()
    assert find_unmet_requirements(bucket, result(min_ttc=0.9), result(ds=65.0)) == (
        "not difficult: expected a blind TTC below 0.9 s, found 0.90 s",
        "not solvable: expected omniscient to reach DS 100, found 65.00",
    )


@pytest.mark.parametrize("bucket", ["V2XPnP", "Real2Sim"])
def test_what_was_recorded_need_only_be_driven_to_its_end(bucket: str) -> None:
    assert find_unmet_requirements(bucket, result(min_ttc=None), result(ds=60.0)) == ()
    assert find_unmet_requirements(bucket, result(), result(ds=50.0, rc=99.5)) == (
        "not solvable: expected omniscient to reach RC 100, found 99.50",
    )


def pose_at_start(ahead: float = 0.0, aside: float = 0.0) -> Pose:
    """A place near the first CAV's start."""
    start = ours(TOWN).egos[0].start
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    return Pose(x=start.x + ahead * cos - aside * sin, y=start.y + ahead * sin + aside * cos, yaw=start.yaw)


def prop(name: str, pose: Pose, size: float = 1.0) -> Actor:
    return Actor(id=name, kind="static", length=size, width=size, start=pose)


def vehicle(at: float = 0.0, **more: object) -> BackgroundVehicle:
    """A vehicle whose box is centred `at` metres ahead of the first CAV's, on its lane."""
    ego = ours(TOWN).egos[0]
    lane = town().lanes[ego.lanes[0]]
    along = lane.centre.project(ego.start.x, ego.start.y)[0] + at + 2.5
    about = {"id": "car", "depart_s": 0.0, "edges": (lane.edge,), "depart_lane": lane.index, "depart_pos_m": along}
    return BackgroundVehicle.model_validate(about | more)


def complaints(
    actors: Sequence[Actor] = (), vehicles: Sequence[BackgroundVehicle] = (), mode: BackgroundMode = "reactive"
) -> str:
    background = Background(vehicles=tuple(vehicles), mode=mode)
    changed = ours(TOWN).model_copy(update={"actors": tuple(actors), "background": background})
    return "; ".join(find_spawn_overlaps(changed, town()))


def test_a_vehicle_that_departs_inside_a_cav_is_told() -> None:
    assert complaints(vehicles=[vehicle(at=2.0)]).startswith("CAV 0 and vehicle car start inside each other (5.")
    assert complaints(vehicles=[vehicle(at=6.0)]) == ""
    assert complaints(vehicles=[vehicle(at=2.0, depart_s=5.0)]) == ""  # waits until there is room


def test_a_vehicle_of_a_log_is_where_its_log_has_it() -> None:
    here, away = pose_at_start(), pose_at_start(ahead=10.0)
    inside = vehicle(at=20.0, log=((0.0, here.x, here.y, here.yaw),))
    beside = vehicle(log=((0.0, away.x, away.y, away.yaw),))
    assert "CAV 0 and vehicle car" in complaints(vehicles=[inside], mode="replay")
    assert complaints(vehicles=[beside], mode="replay") == ""
    assert "CAV 0 and vehicle car" in complaints(vehicles=[beside])


def test_props_inside_each_other_are_told() -> None:
    one, other = prop("a", pose_at_start(8.0)), prop("b", pose_at_start(8.5))
    assert complaints([one, other]) == "actor a and actor b start inside each other (0.36 m2 overlap)"
    assert complaints([one, prop("b", pose_at_start(8.92))]) == ""  # a log knows its places no better


def test_a_prop_where_a_vehicle_departs_is_told() -> None:
    told = complaints([prop("a", FURTHER)], [vehicle(at=12.0)])
    assert told == "vehicle car and actor a start inside each other (0.81 m2 overlap)"


def test_an_actor_that_waits_for_a_trigger_stands_and_one_that_moves_does_not() -> None:
    start, end = pose_at_start(8.0), pose_at_start(20.0)
    walk = PathMotion(points=((start.x, start.y), (end.x, end.y)), speed=1.0)
    walker = Actor(id="walker", kind="pedestrian", length=0.5, width=0.5, start=start, motion=walk)
    assert complaints([prop("a", start), walker]) == ""
    waits = walker.model_copy(update={"trigger": TimeTrigger(at_s=3.0)})
    assert "actor a and actor walker start inside each other" in complaints([prop("a", start), waits])


def test_a_cav_that_starts_in_a_building_is_told() -> None:
    house = town().building_shapes[0].representative_point()
    ego = ours(TOWN).egos[0].model_copy(update={"start": Pose(x=house.x, y=house.y, yaw=0.0)})
    changed = ours(TOWN).model_copy(update={"egos": (ego,)})
    assert list(find_spawn_overlaps(changed, town())) == ["CAV 0 starts inside a building"]


def suite_of(folder: Path, *scenarios: Scenario, parts: tuple[str, ...] = ()) -> Suite:
    save_suite(Suite(SuiteFile(name=folder.name, title="", parts=parts), folder, scenarios))
    return load_suite(str(folder))


def examined(folder: Path, **changes: object) -> ScenarioValidation:
    """What is found in a scenario of ours with changes."""
    suite = suite_of(folder / "changed", ours(TOWN).model_copy(update=changes))
    return validate_scenario(ValidationTask(suite.folder, TOWN))


def test_a_route_that_does_not_connect_is_told(tmp_path: Path) -> None:
    ego = ours(TOWN).egos[0]
    jump = ego.model_copy(update={"lanes": (ego.lanes[0], ego.lanes[-1])})
    (problem,) = examined(tmp_path, egos=(jump, *ours(TOWN).egos[1:])).problems
    assert "expected a lane after or beside" in problem


def test_an_actor_in_a_cav_is_told_once(tmp_path: Path) -> None:
    (problem,) = examined(tmp_path, actors=(prop("a", pose_at_start()),)).problems
    assert problem == f"scenario {TOWN}: actor a: start: expected room, found CAV 0 there (1.00 m2 overlap)"


def test_every_road_user_without_room_is_reported(tmp_path: Path) -> None:
    props = tuple(prop(name, pose_at_start(ahead)) for name, ahead in (("a", 8.0), ("b", 8.5)))
    background = Background(vehicles=(vehicle(at=12.0),))
    assert len(examined(tmp_path, actors=(*props, prop("c", FURTHER)), background=background).problems) == 2


def test_a_harmless_recording_passes_and_is_told(tmp_path: Path) -> None:
    found = examined(tmp_path, bucket="V2XPnP", egos=ours(TOWN).egos[:1])
    assert found.problems == ()
    assert not found.is_difficult


def validate(*words: str) -> Result:
    return CliRunner().invoke(main, ["validate", *words, "--workers", "1"])


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Suite, Result]:
    """A suite of two parts, validated with --write."""
    folder = tmp_path_factory.mktemp("suites")
    suite_of(folder / "a", ours(TOWN))
    suite_of(folder / "b", ours("i25_ins_oppo_boulevard"))
    suite_of(folder / "both", parts=("a", "b"))
    told = validate(str(folder / "both"), "--write")
    return load_suite(str(folder / "both")), told


@pytest.mark.slow
def test_a_suite_of_parts_passes(both: tuple[Suite, Result]) -> None:
    _, told = both
    assert told.exit_code == 0
    assert f"{TOWN}: ok, hidden until late\n" in told.output
    assert told.output.endswith("2 of 2 pass; 2 difficult, 1 hidden until late\n")


def test_certificates_are_written_beside_each_part(both: tuple[Suite, Result]) -> None:
    suite, _ = both
    assert not (suite.folder / CERTIFICATE_FILE).exists()
    assert [list(OcclusionCertificateFile.load(part)) for part in suite.parts] == [[TOWN], ["i25_ins_oppo_boulevard"]]
    shown = CliRunner().invoke(main, ["list", "scenarios", "--suite", str(suite.folder), "--occluded"])
    assert TOWN in shown.output
    assert "i25" not in shown.output


def test_reference_times_are_written_beside_each_part(both: tuple[Suite, Result]) -> None:
    suite, told = both
    assert not (suite.folder / REFERENCE_TIMES_FILE).exists()
    for part in suite.parts:
        (scenario,) = part.scenarios
        found = find_reference_times(scenario, part.folder)
        assert set(found) == {ego.id for ego in scenario.egos}
        assert f"{part.folder / REFERENCE_TIMES_FILE}  times of 1 scenarios" in told.output


def test_writing_some_scenarios_needs_the_others_unchanged(tmp_path: Path) -> None:
    suite = suite_of(tmp_path / "mine", ours(TOWN), ours("i25_ins_oppo_boulevard"))
    told = validate(str(suite.folder), "--scenario", TOWN, "--write")
    assert told.exit_code == 2
    assert "found none for i25_ins_oppo_boulevard; --scenario has to include it" in told.output
    assert validate("interdrive@0", "--scenario", TOWN, "--sample", "1").exit_code == 2


@pytest.mark.slow
def test_writing_one_scenario_keeps_what_is_known_of_the_others(tmp_path: Path) -> None:
    other = ours("i25_ins_oppo_boulevard")
    suite = suite_of(tmp_path / "mine", ours(TOWN), other)
    kept = OcclusionCertificate(scenario=other.id, hidden=())
    OcclusionCertificateFile(suite_checksum="sha256:of before", certificates=(kept,)).save(suite.folder)
    save_reference_times(suite, {one.id: {ego.id: 7 for ego in one.egos} for one in suite})
    told = validate(str(suite.folder), "--scenario", TOWN, "--write")
    assert told.exit_code == 0, told.output
    assert (
        OcclusionCertificateFile.load(suite)[other.id] == kept and OcclusionCertificateFile.load(suite)[TOWN].occluded
    )
    assert set(find_reference_times(other, suite.folder).values()) == {7}
    assert min(find_reference_times(ours(TOWN), suite.folder).values()) > 7


def test_a_scenario_that_fails_is_exit_code_1(tmp_path: Path) -> None:
    suite_of(tmp_path / "bad", ours(TOWN).model_copy(update={"actors": (prop("a", pose_at_start()),)}))
    told = validate(str(tmp_path / "bad"))
    assert told.exit_code == 1
    assert told.output.endswith("0 of 1 pass; 0 difficult, 0 hidden until late\n")


@pytest.mark.slow
def test_a_suite_that_fails_as_a_whole_is_exit_code_1(tmp_path: Path) -> None:
    about = SuiteFile(name="interdrive", title="")
    save_suite(Suite(about, tmp_path, (ours(TOWN),)))
    told = validate(str(tmp_path), "--sample", "1")
    assert told.exit_code == 1
    assert "interdrive: expected 46 scenarios, found 1\n" in told.output


def test_a_suite_that_was_changed_after_it_was_sealed_is_exit_code_2(tmp_path: Path) -> None:
    suite = seal_suite(suite_of(tmp_path / "mine", ours(TOWN)))
    save_suite(suite)
    save_suite(replace(suite, scenarios=(ours(TOWN).model_copy(update={"weather": "rain"}),)))
    told = validate(str(suite.folder))
    assert told.exit_code == 2
    assert "suite.json: checksum: expected scenarios and networks with sha256:" in told.output


def test_a_scenario_that_breaks_the_schema_is_exit_code_2(tmp_path: Path) -> None:
    suite = suite_of(tmp_path / "mine", ours(TOWN))
    (suite.folder / TOWN / SCENARIO_FILE).write_text("{}")
    told = validate(str(suite.folder))
    assert told.exit_code == 2
    assert f"{TOWN}/{SCENARIO_FILE}: id: Field required" in told.output


def test_write_and_sample_do_not_go_together() -> None:
    assert validate("interdrive@0", "--write", "--sample", "1").exit_code == 2
