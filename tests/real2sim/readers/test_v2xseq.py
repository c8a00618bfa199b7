"""V2X-Seq: small scenes in its layout. No real scene was available."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.convert_command import refused, run
from testing.v2xseq_samples import describe_map, list_rows, write_scene

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.suite import load_suite
from real2sim.hd_map import LaneKind
from real2sim.readers.v2xseq import read_v2xseq
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

Scene = tuple[Path, Path]


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return write_scene(tmp_path)


def tracks_of(recording: Recording) -> dict[str, RecordedTrack]:
    return {track.id: track for track in recording.views[0].tracks}


def test_rows_become_tracks_on_a_grid_of_frames(scene: Scene) -> None:
    recording = read_v2xseq(scene[0], [scene[1]])
    assert (recording.id, recording.dt_s, recording.frame_count, recording.cavs) == ("10039", 0.1, 31, ("7",))
    tracks = tracks_of(recording)
    np.testing.assert_allclose(tracks["7"].x, 10 + 0.8 * np.arange(31), atol=0.006)
    assert [tracks[name].category for name in "789"] == [
        ObjectCategory.CAR,
        ObjectCategory.CAR,
        ObjectCategory.PEDESTRIAN,
    ]
    assert (tracks["8"].length[0], tracks["8"].width[0], tracks["8"].yaw[0]) == (4.6, 1.9, pytest.approx(3.1415))


def test_a_map_of_texts_becomes_lanes_with_links(scene: Scene) -> None:
    hd_map = read_v2xseq(scene[0], [scene[1]]).map
    first, second, bike = (hd_map.lanes[name] for name in ("11", "12", "13"))
    np.testing.assert_array_equal(first.centre, [(0, 0), (30, 0), (60, 0)])
    assert (first.exits, first.entries, first.left_neighbour, first.right_neighbour) == (("12",), (), "", "13")
    assert (first.junction, second.junction, second.entries) == (False, True, ("11",))
    assert bike.kind is LaneKind.BIKE
    assert (len(hd_map.crosswalks), len(hd_map.stop_lines)) == (1, 1)


def test_of_several_maps_the_one_that_the_tracks_lie_on_is_taken(scene: Scene) -> None:
    other = scene[1].with_name("hdmap2.json")
    away = json.loads(scene[1].read_text())
    away["LANE"] = {"11": away["LANE"]["11"] | {"centerline": ["(0, 900)", "(60, 900)"], "successors": []}}
    other.write_text(json.dumps(away))
    assert read_v2xseq(scene[0], [other, scene[1]]).notes == ("map: hdmap1.json",)
    with pytest.raises(InputError, match="found 100% of their points more than 30 m off"):
        read_v2xseq(scene[0], [other])


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_scene_is_converted(scene: Scene, tmp_path: Path) -> None:
    done = run("v2xseq", scene[0].parent, "--map", scene[1], "--out", tmp_path / "suite", "--workers", "1")
    assert done.exit_code == 0, done.stderr
    (scenario,) = load_suite(str(tmp_path / "suite")).scenarios
    assert len(scenario.egos) == 1


def test_a_map_is_asked_for(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"10039\.csv: expected the map of its crossing, found none"):
        read_v2xseq(scene[0], [])
    assert refused(tmp_path, "v2xseq", scene[0]) == "v2xseq: expected the map of the crossing, found no --map"


ROWS: dict[str, tuple[Callable[[list[str]], list[str]], str]] = {
    "no rows": (lambda _: [], "expected at least one row, found none"),
    "short": (lambda rows: [*rows, "PEK,1"], "expected 16 columns, found 2"),
    "twice": (lambda rows: [*rows, rows[0]], "line 95: expected one row of object 7 at a time, found two"),
    "off the clock": (
        lambda rows: [rows[0], rows[1].replace("1626.300", "1626.350")],
        "line 3: timestamp: expected steps of 0.1 s, found 0.150 s after the first",
    ),
    "no number": (
        lambda rows: [rows[0].replace(",10.00,", ",here,")],
        "line 2: x: expected a finite number, found 'here'",
    ),
    "a type": (lambda rows: [rows[0].replace("VEHICLE,CAR", "TRAM,TRAM")], "sub_type: expected one of car, van"),
    "no end": (
        lambda rows: [rows[0], rows[1].replace("1626.300", "99999999")],
        "timestamp: expected times within 36000 frames",
    ),
}


@pytest.mark.parametrize("name", ROWS)
def test_damaged_scenes(tmp_path: Path, name: str) -> None:
    damage, words = ROWS[name]
    path, map_ = write_scene(tmp_path, damage(list_rows()))
    with pytest.raises(InputError) as caught:
        read_v2xseq(path, [map_])
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def set_lane(name: str, value: Any) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["LANE"]["11"].update({name: value})


MAPS: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "no lanes": (lambda content: content["LANE"].clear(), "LANE"),
    "no line": (set_lane("centerline", []), "LANE.11.centerline"),
    "a word for a point": (set_lane("centerline", ["(0, 0)", "here"]), "LANE.11.centerline.1"),
    "no finite point": (set_lane("centerline", ["(0, 0)", "(nan, 0)"]), "LANE 11: expected finite coordinates"),
    "one place": (
        set_lane("centerline", ["(0, 0)", "(0, 0)"]),
        "LANE 11: expected at least two distinct points, found 1",
    ),
}


@pytest.mark.parametrize("name", MAPS)
def test_damaged_maps(scene: Scene, name: str) -> None:
    damage, words = MAPS[name]
    content = describe_map()
    damage(content)
    scene[1].write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        read_v2xseq(scene[0], [scene[1]])
    assert words in str(caught.value)
    assert str(scene[1]) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"LANE": 3}'])
def test_files_that_are_no_map(scene: Scene, text: str) -> None:
    scene[1].write_text(text)
    with pytest.raises(InputError, match=r"hdmap1\.json: "):
        read_v2xseq(scene[0], [scene[1]])
