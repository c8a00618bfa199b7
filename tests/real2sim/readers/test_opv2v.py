"""OPV2V and V2V4Real: small logs in their layouts. No real log was available."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from testing.convert_command import refused, run
from testing.opendrive_samples import format_geometry, format_map, format_road
from testing.opv2v_samples import format_frame, format_real_frame, locate, write_log, write_real_log

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.suite import load_suite
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.opv2v import LogFrame, read_opv2v
from real2sim.recording import ObjectCategory

ROAD = HdMap({"a": MapLane("a", LaneKind.DRIVING, np.array([(0.0, 0.0), (100.0, 0.0)]))})
CARLA = LogFrame(is_carla=True, offset=(100.0, 7.0))
PLACED = HdMap({"a": MapLane("a", LaneKind.DRIVING, np.array([(100.0, 7.0), (200.0, 7.0)]))})


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "2021_08_22_21_41_24", frames=5)


def test_frames_in_steps_of_two_are_ten_a_second(log: Path) -> None:
    recording = read_opv2v(log, ROAD, LogFrame())
    assert (recording.id, recording.dt_s, recording.frame_count) == ("2021_08_22_21_41_24", 0.1, 5)
    assert recording.cavs == ("641", "650")
    assert [(view.observer, view.is_infrastructure) for view in recording.views] == [
        ("641", False),
        ("650", False),
        ("-1", True),
    ]
    assert "frames are numbered in steps of 2 and taken as 0.1 s apart" in recording.notes


def test_coordinates_of_carla_are_mirrored_and_moved(log: Path) -> None:
    view = read_opv2v(log, PLACED, CARLA).views[0]
    (oncoming,) = [track for track in view.tracks if track.id == "700"]
    for frame in range(5):
        x, y, _ = locate("700", frame)
        np.testing.assert_allclose((oncoming.x[frame], oncoming.y[frame]), (100 + x, 7 - y))
        x, y, _ = locate("641", frame)
        np.testing.assert_allclose(view.pose[frame], (100 + x, 7 - y, 0.0), atol=1e-12)
    np.testing.assert_allclose(np.abs(oncoming.yaw), np.pi)
    assert (oncoming.category, oncoming.length[0], oncoming.width[0]) == (ObjectCategory.CAR, 4.8, 2.0)


def test_the_centre_of_a_box_lies_ahead_along_its_heading(log: Path) -> None:
    path = log / "641" / "000068.yaml"
    text = path.read_text().replace("    - 0.0\n    - 0.0\n    - 0.7", "    - 1.0\n    - 0.0\n    - 0.7")
    path.write_text(text)
    (oncoming,) = [track for track in read_opv2v(log, ROAD, LogFrame()).views[0].tracks if track.id == "700"]
    assert oncoming.x[0] == pytest.approx(locate("700", 0)[0] - 1.0)
    assert oncoming.x[1] == pytest.approx(locate("700", 1)[0])


def test_frames_that_an_agent_lacks_are_not_observed_by_it(log: Path) -> None:
    (log / "650" / "000068.yaml").unlink()
    recording = read_opv2v(log, ROAD, LogFrame())
    assert "agent 650 lacks 1 of 5 frames: nothing is observed by it there" in recording.notes
    late = recording.views[1]
    assert np.isnan(late.pose[0]).all() and np.isfinite(late.pose[1:]).all()
    assert all(track.valid.tolist() == [False, True, True, True, True] for track in late.tracks)


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_log_and_the_map_of_its_town_become_a_scenario(tmp_path: Path) -> None:
    """The way of users: CARLA's coordinates, and the town as OpenDRIVE map, whose network lies elsewhere."""
    log = write_log(tmp_path / "2021_08_22_21_41_24")
    town = tmp_path / "TownXX.xodr"
    town.write_text(format_map(format_road(geometry=format_geometry(length=150, x=-20), length=150)))
    done = run("opv2v", log, "--map", town, "--out", tmp_path / "suite", "--workers", "1")
    assert done.exit_code == 0, done.stderr
    (scenario,) = load_suite(str(tmp_path / "suite")).scenarios
    assert len(scenario.egos) == 2


def rename(old: str, new: str) -> Callable[[Path], object]:
    return lambda folder: (folder / old).rename(folder / new)


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "no agents": (lambda folder: [rename(name, f"a{name}")(folder) for name in ("641", "650", "-1")], "found none"),
    "no CAVs": (lambda folder: [rename(name, f"-{name}")(folder) for name in ("641", "650")], "found [-650, -641, -1]"),
    "no frames": (
        lambda folder: [path.unlink() for path in (folder / "650").glob("*.yaml")],
        "expected frames such as 000068.yaml, found no such file",
    ),
    "an odd frame": (
        rename("641/000072.yaml", "641/000073.yaml"),
        "000073.yaml: expected a frame number in steps of 2 from 68, found 73",
    ),
    "frames without end": (
        rename("641/000076.yaml", "641/900000000.yaml"),
        "expected times within 36000 frames, found",
    ),
    "no pose": (
        lambda folder: (folder / "641/000068.yaml").write_text("vehicles: {}\n"),
        "lidar_pose: expected 6 numbers, found None",
    ),
    "a small matrix for a pose": (
        lambda folder: (folder / "641/000068.yaml").write_text("lidar_pose: [[1,0],[0,1]]\nvehicles: {}\n"),
        "lidar_pose: expected 6 numbers, found [[1, 0], [0, 1]]",
    ),
    "a word": (
        lambda folder: (folder / "641/000068.yaml").write_text(format_frame(0).replace("3e-02", "near")),
        "expected 3 numbers, found",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_logs(log: Path, name: str) -> None:
    damage, words = DAMAGE[name]
    damage(log)
    with pytest.raises(InputError) as caught:
        read_opv2v(log, ROAD, LogFrame())
    assert words in str(caught.value)
    assert str(log) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_frame_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected at least two frames of one agent, found one of each"):
        read_opv2v(write_log(tmp_path / "log", frames=1), ROAD, LogFrame())


def test_a_map_of_another_place_is_refused(log: Path) -> None:
    with pytest.raises(InputError, match="found 100% of their points more than 30 m off"):
        read_opv2v(log, ROAD, LogFrame(is_carla=True, offset=(0.0, 900.0)))


def test_a_map_is_asked_for(log: Path, tmp_path: Path) -> None:
    assert refused(tmp_path, "opv2v", log) == "opv2v: expected the map of the town, found no --map"


@pytest.mark.parametrize("module", ["numpy.core", "numpy._core"])
def test_boxes_of_v2v4real_are_moved_from_the_lidar_to_the_world(tmp_path: Path, module: str) -> None:
    recording = read_opv2v(write_real_log(tmp_path / "log", module=module), ROAD, LogFrame())
    assert (recording.cavs, recording.frame_count) == (("0", "1"), 5)
    for view, car in zip(recording.views, ("641", "650"), strict=True):
        (truck,) = [track for track in view.tracks if track.id == "4"]
        assert truck.category is ObjectCategory.TRUCK
        for frame in range(5):
            x, y, _ = locate("700", frame)
            np.testing.assert_allclose((truck.x[frame], truck.y[frame]), (x, -y), atol=1e-9)
            x, y, _ = locate(car, frame)
            np.testing.assert_allclose(view.pose[frame, :2], (x, -y), atol=1e-9)
        np.testing.assert_allclose(np.cos(truck.yaw), -1.0)


def test_objects_of_v2v4real_have_common_ids_or_ids_of_their_agent(tmp_path: Path) -> None:
    """Ids change their meaning from agent to agent: the common id names an object, also where a frame lacks it."""
    first, second = read_opv2v(write_real_log(tmp_path / "log"), ROAD, LogFrame()).views
    assert {track.id for track in first.tracks} == {"3", "4"}
    assert {track.id for track in second.tracks} == {"5", "4"}
    log = write_real_log(tmp_path / "alone")
    for path in log.glob("*/*.yaml"):
        path.write_text(re.sub(r"ass_id: [345]", "ass_id: -1", path.read_text()))
    first, second = read_opv2v(log, ROAD, LogFrame()).views
    assert {track.id for track in first.tracks} == {"0_2", "0_3"}
    assert {track.id for track in second.tracks} == {"1_1", "1_5"}


def test_two_objects_with_one_common_id_stay_two(tmp_path: Path) -> None:
    log = write_real_log(tmp_path / "log")
    for path in log.glob("0/*.yaml"):
        path.write_text(path.read_text().replace("ass_id: 3", "ass_id: 4"))
    assert [track.id for track in read_opv2v(log, ROAD, LogFrame()).views[0].tracks] == ["4", "0_3"]


def test_a_right_handed_log_is_not_mirrored_with_an_opendrive_map(tmp_path: Path) -> None:
    recording = read_opv2v(write_real_log(tmp_path / "log"), PLACED, CARLA)
    x, y, _ = locate("641", 0)
    np.testing.assert_allclose(recording.views[0].pose[0, :2], (100 + x, 7 - y))


def test_types_are_used_where_the_log_has_them(log: Path) -> None:
    assert "objects without types, classed by their size" in read_opv2v(log, ROAD, LogFrame()).notes
    for path in log.glob("*/*.yaml"):
        path.write_text(path.read_text().replace("    location:", "    obj_type: Van\n    location:"))
    recording = read_opv2v(log, ROAD, LogFrame())
    assert {track.category for view in recording.views for track in view.tracks} == {ObjectCategory.VAN}
    assert not any("without types" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ("[[1,0,0,5],[0,1,0,5],[0,0,-1,1],[0,0,0,1]]", "expected a rotation, a translation and a last row 0, 0, 0, 1"),
        ("[[2,0,0,5],[0,2,0,5],[0,0,2,1],[0,0,0,1]]", "expected a rotation, a translation"),
        ("[[1,0,0,5],[0,1,0,5],[0,0,1,1],[0,0,1,1]]", "expected a rotation, a translation"),
        ("[[1,0,0,.nan],[0,1,0,5],[0,0,1,1],[0,0,0,1]]", "expected a rotation, a translation"),
        ("[[1e+300,0,0,5],[0,1,0,5],[0,0,1,1],[0,0,0,1]]", "expected a rotation, a translation"),
        ("[[1,0,0,5],[0,1,0,5],[0,0,1],[0,0,0,1]]", "row 2: expected 4 numbers"),
        ("[[1,0,0,5],[0,1,0,5],[0,0,a,1],[0,0,0,1]]", "row 2: expected 4 numbers"),
        ("[1,2,3,4]", "row 0: expected 4 numbers"),
    ],
)
def test_matrices_that_are_no_poses(tmp_path: Path, matrix: str, words: str) -> None:
    log = write_real_log(tmp_path / "log", frames=2)
    (log / "0/000001.yaml").write_text(f"lidar_pose: {matrix}\nvehicles: {{}}\n")
    with pytest.raises(InputError) as caught:
        read_opv2v(log, ROAD, LogFrame())
    assert f"{log / '0/000001.yaml'}: lidar_pose" in str(caught.value) and words in str(caught.value)


def test_code_named_in_a_file_is_not_run(tmp_path: Path) -> None:
    log = write_real_log(tmp_path / "log", frames=2)
    trap = tmp_path / "trap"
    text = format_real_frame(1).replace("ego_speed: 0", f"ego_speed: !!python/object/apply:os.mkdir [{trap}]")
    (log / "0/000001.yaml").write_text(text)
    with pytest.raises(InputError, match="expected well-formed YAML, found: could not determine a constructor"):
        read_opv2v(log, ROAD, LogFrame())
    assert not trap.exists()


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_log_of_v2v4real_becomes_a_scenario(tmp_path: Path) -> None:
    log = write_real_log(tmp_path / "log", frames=31)
    road = tmp_path / "road.xodr"
    road.write_text(format_map(format_road(geometry=format_geometry(length=150, x=-20), length=150)))
    done = run("opv2v", log, "--map", road, "--out", tmp_path / "suite", "--workers", "1")
    assert done.exit_code == 0, done.stderr
    (scenario,) = load_suite(str(tmp_path / "suite")).scenarios
    assert len(scenario.egos) == 2
