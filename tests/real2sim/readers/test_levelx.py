"""leveLXData: small recordings in the layouts of inD and highD. No real recording was available."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from testing.convert_command import run
from testing.levelx_samples import (
    format_ground_row,
    write_ground,
    write_image,
    write_lines,
)

from mdrive_sumo.core.errors import InputError
from real2sim.readers import levelx
from real2sim.readers.levelx import read_levelx
from real2sim.recording import ObjectCategory, RecordedTrack, Recording


def tracks_of(recording: Recording) -> dict[str, RecordedTrack]:
    return {track.id: track for track in recording.views[0].tracks}


@pytest.fixture
def ground(tmp_path: Path) -> Path:
    rows = [format_ground_row(3, frame, frame * 0.4) for frame in range(101)]
    rows += [format_ground_row(5, frame, 40 - frame * 0.04, 9.0, 180.0, (0, 0)) for frame in range(20, 61)]
    return write_ground(tmp_path, rows, {3: "car", 5: "pedestrian"})


@pytest.fixture
def image(tmp_path: Path) -> Path:
    rows = [f"{frame},1,{frame * 1.2},22.1,4.5,1.8,30,0,0,0,5" for frame in range(1, 102)]
    rows += [f"{frame},2,{200 - frame * 1.0},13.0,12.0,2.5,-25,0,0,0,3" for frame in range(1, 102)]
    return write_image(tmp_path, rows, {1: ("Car", 2), 2: ("Truck", 1)})


def test_tracks_of_ind_are_box_centres_in_the_frame_of_the_map(ground: Path) -> None:
    recording = read_levelx(ground)
    assert (recording.id, recording.dt_s, recording.frame_count, recording.cavs) == ("07_tracks", 0.08, 51, ())
    car, walker = (tracks_of(recording)[name] for name in ("3", "5"))
    np.testing.assert_allclose(car.x, np.arange(51) * 0.8)
    assert (car.category, car.length[0], car.width[0]) == (ObjectCategory.CAR, 4.5, 1.8)
    assert walker.category is ObjectCategory.PEDESTRIAN
    assert walker.valid_frames.tolist() == list(range(10, 31))
    assert np.isnan(walker.length).all() and np.isnan(walker.width).all()
    assert abs(walker.yaw[10]) == pytest.approx(math.pi)
    assert "one of every 2 frames taken, of 25 a second" in recording.notes
    lane = recording.map.lanes["1"]
    assert shapely.LineString(lane.centre).distance(shapely.Point(car.x[10], car.y[10])) < 0.05


def test_highd_has_corners_in_an_image_and_markings_for_a_map(image: Path) -> None:
    recording = read_levelx(image)
    car, truck = (tracks_of(recording)[name] for name in ("1", "2"))
    np.testing.assert_allclose((car.x[0], car.y[0], car.yaw[0]), (1.2 + 2.25, -23.0, 0.0))
    np.testing.assert_allclose((truck.x[0], truck.y[0], abs(truck.yaw[0])), (205.0, -14.25, math.pi))
    assert (truck.category, truck.length[0], truck.width[0]) == (ObjectCategory.TRUCK, 12.0, 2.5)
    lanes = recording.map.lanes
    assert set(lanes) == {"upper0", "upper1", "lower0", "lower1"}
    assert lanes["lower0"].centre[:, 1].tolist() == [-23.0, -23.0]
    assert (lanes["lower0"].left_neighbour, lanes["lower0"].right_neighbour) == ("", "lower1")
    assert (lanes["upper1"].left_neighbour, lanes["upper1"].right_neighbour) == ("", "upper0")
    assert math.isnan(lanes["upper0"].speed_limit)
    for lane in lanes.values():
        ahead = lane.centre[1] - lane.centre[0]
        assert math.copysign(1, ahead[0]) == (1 if lane.id.startswith("lower") else -1)
        to_left = lane.left[0] - lane.centre[0]
        assert ahead[0] * to_left[1] - ahead[1] * to_left[0] > 0
        assert lane.width == 4.0


def test_large_recordings_are_thinned_further(image: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levelx, "MAX_ROWS", 60)
    recording = read_levelx(image)
    assert recording.dt_s == pytest.approx(4 / 25)
    assert tracks_of(recording)["1"].x[1] == pytest.approx(5 * 1.2 + 2.25)


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["ground", "image"])
@pytest.mark.usefixtures("in_process")
def test_they_are_converted(layout: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    tracks: Path = request.getfixturevalue(layout)
    done = run("levelx", tracks.parent, "--out", tmp_path / "suite", "--workers", "1")
    assert done.exit_code in (0, 1), done.stderr
    assert (tmp_path / "suite" / tracks.stem / "scenario.json").is_file()


Damage = Callable[[Path], object]


def replace(kind: str, old: str, new: str) -> Damage:
    def damage(tracks: Path) -> None:
        path = tracks.with_name(tracks.name.replace("tracks", kind))
        path.write_text(path.read_text().replace(old, new))

    return damage


BAD_GROUND: dict[str, tuple[Damage, str]] = {
    "no meta": (lambda tracks: (tracks.parent / "07_recordingMeta.csv").unlink(), "cannot be read: No such file"),
    "no track meta": (lambda tracks: (tracks.parent / "07_tracksMeta.csv").unlink(), "cannot be read: No such file"),
    "no rows of meta": (
        lambda tracks: write_lines(tracks.parent / "07_recordingMeta.csv", "recordingId,frameRate"),
        "expected one row of 2 columns, found 0",
    ),
    "no tracks": (
        lambda tracks: write_lines(tracks.parent / "07_tracksMeta.csv", "trackId,class,initialFrame,finalFrame"),
        "expected at least one track, found none",
    ),
    "no rate": (replace("recordingMeta", "frameRate", "rate"), "expected the column frameRate, found none"),
    "a rate of 0": (replace("recordingMeta", "25.0", "0"), "frameRate: expected 1 to 100, found 0"),
    "no origin": (replace("recordingMeta", "xUtmOrigin", "x"), "expected the column xUtmOrigin, found none"),
    "an unknown class": (replace("tracksMeta", "pedestrian", "tram"), "line 3: class: expected one of car, van"),
    "no position": (
        replace("tracks", "0,3,4,0,1.6,", "0,3,4,0,nan,"),
        "xCenter: expected a finite number, found 'nan'",
    ),
    "an unknown track": (replace("tracks", "0,3,4,0,", "0,9,4,0,"), "expected a track and a frame of the tracksMeta"),
    "a late frame": (replace("tracks", "0,3,4,0,", "0,3,999,0,"), "expected a track and a frame of the tracksMeta"),
    "no column": (replace("tracks", "xCenter", "x"), "expected the column xCenter, found recordingId"),
    "frames without end": (replace("tracksMeta", ",100,", ",100000000,"), "frame: expected times within 36000 frames"),
    "no map": (replace("recordingMeta", "7,4,", "7,5,"), "expected one Lanelet2 map maps/.../location5.osm (or --map)"),
}


@pytest.mark.parametrize("name", BAD_GROUND)
def test_damaged_recordings(ground: Path, name: str) -> None:
    damage, words = BAD_GROUND[name]
    damage(ground)
    with pytest.raises(InputError) as caught:
        read_levelx(ground)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (replace("recordingMeta", "8.5;12.5;16.5", "8.5"), "upperLaneMarkings: expected at least two markings"),
        (replace("recordingMeta", "12.5", "wide"), "upperLaneMarkings: expected a finite number, found 'wide'"),
        (replace("tracksMeta", "Car,2", "Car,3"), "drivingDirection: expected 1 or 2, found '3'"),
    ],
)
def test_damaged_recordings_of_highd(image: Path, damage: Damage, words: str) -> None:
    damage(image)
    with pytest.raises(InputError, match=words):
        read_levelx(image)


def test_another_name_is_refused(ground: Path) -> None:
    with pytest.raises(InputError, match=r"expected the tracks of a recording, NN_tracks\.csv, found another name"):
        read_levelx(ground.rename(ground.with_name("07.csv")))
