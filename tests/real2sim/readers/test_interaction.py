"""INTERACTION: the real recording, small tables, and damaged ones."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from testing.interaction_samples import VEHICLES, build_street, write_table

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap
from real2sim.readers.interaction import find_interaction_map, list_cases, read_interaction
from real2sim.readers.time_grid import crop_recording
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

MAP = "DR_USA_Intersection_EP0.osm"


@pytest.fixture(scope="module")
def real(data: Path) -> Recording:
    return read_interaction(data, data / MAP)


def _tracks(recording: Recording) -> tuple[RecordedTrack, ...]:
    return recording.views[0].tracks


def _vehicle_points(recording: Recording) -> np.ndarray:
    """(N, 3) x, y, yaw of every tenth frame."""
    vehicles = (track for track in _tracks(recording) if track.category.kind is Kind.VEHICLE)
    return np.concatenate([np.column_stack((one.xy, one.yaw))[one.valid_frames[::10]] for one in vehicles])


def _areas(hd_map: HdMap) -> list[shapely.Geometry]:
    rings = (np.concatenate((lane.left, lane.right[::-1])) for lane in hd_map.lanes.values())
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in rings]


@pytest.mark.slow
def test_real_counts_and_clock(real: Recording) -> None:
    kinds = [track.category.kind for track in _tracks(real)]
    assert (kinds.count(Kind.VEHICLE), kinds.count(Kind.PEDESTRIAN)) == (74, 23)
    assert (real.dt_s, real.frame_count, len(real.map.lanes)) == (0.1, 3007, 59)
    assert real.cavs == ()


def test_real_table_is_read_cell_by_cell(real: Recording, data: Path) -> None:
    """Against the text itself, split by hand."""
    by_id = {track.id: track for track in _tracks(real)}
    for name in ("vehicle_tracks_000.csv", "pedestrian_tracks_000.csv"):
        lines = (data / name).read_text().splitlines()[1:]
        for line in lines[:: len(lines) // 50]:
            cells = line.split(",")
            track, row = by_id[cells[0]], int(cells[1]) - 1
            assert track.valid[row]
            assert (track.x[row], track.y[row]) == (float(cells[4]), float(cells[5]))
            box = [float(cell) for cell in cells[8:]] or [math.nan] * 3
            np.testing.assert_array_equal([track.yaw[row], track.length[row], track.width[row]], box)
        assert sum(by_id[one].valid.sum() for one in {line.split(",")[0] for line in lines}) == len(lines)


def test_real_vehicles_are_on_lanelets(real: Recording) -> None:
    """As shared/spec/data_formats.md section 6 says; a wrong projection misses by metres."""
    points = _vehicle_points(real)
    road = shapely.union_all(_areas(real.map))
    assert shapely.contains_xy(road, points[:, 0], points[:, 1]).mean() >= 0.99


def test_real_vehicles_drive_along_lanes(real: Recording) -> None:
    """A lanelet read the wrong way round turns its vehicles into wrong-way drivers."""
    tree, lines = shapely.STRtree(_areas(real.map)), [Polyline(lane.centre) for lane in real.map.lanes.values()]
    points = _vehicle_points(real)
    along = 0
    for x, y, yaw in points:
        hits = tree.query(shapely.Point(x, y), predicate="within")
        along += any(math.cos(yaw - lines[hit].yaw_at(lines[hit].project(x, y)[0])) > 0.5 for hit in hits)
    assert along / len(points) >= 0.97


def test_real_lanes_are_linked(real: Recording) -> None:
    lanes = real.map.lanes
    for lane in lanes.values():
        for after in lane.exits:
            assert lane.id in lanes[after].entries
            assert np.hypot(*(lanes[after].centre[0] - lane.centre[-1])) < 1e-6
        for side, back in (("left", "right"), ("right", "left")):
            beside = getattr(lane, f"{side}_neighbour")
            assert not beside or getattr(lanes[beside], f"{back}_neighbour") == lane.id
    dead_ends = [lane for lane in lanes.values() if not lane.exits or not lane.entries]
    assert 0 < len(dead_ends) <= 16  # 5 arms, in and out, of one or two lanes
    assert _reachable(real.map) == set(lanes)


def _reachable(hd_map: HdMap) -> set[str]:
    """Lanes on some way from the rim of the map."""
    queue = [lane.id for lane in hd_map.lanes.values() if not lane.entries]
    seen = set(queue)
    while queue:
        new = set(hd_map.lanes[queue.pop()].exits) - seen
        seen |= new
        queue += new
    return seen


def test_real_rules(real: Recording) -> None:
    np.testing.assert_allclose([lane.speed_limit for lane in real.map.lanes.values()], 15 * 0.44704)
    lines = {line.lanes: line.sign for line in real.map.stop_lines}
    assert lines == dict.fromkeys([("30028",), ("30048",), ("30041", "30046"), ("30056",), ("30057",)], "stop")


def test_real_crosswalks(real: Recording) -> None:
    """Four pairs of lines; most of the pedestrians on the road are on them."""
    walks = shapely.union_all([shapely.Polygon(walk) for walk in real.map.crosswalks])
    walkers = np.concatenate([one.xy[one.valid] for one in _tracks(real) if one.category is ObjectCategory.PEDESTRIAN])
    on_road = walkers[shapely.contains_xy(shapely.union_all(_areas(real.map)), *walkers.T)]
    assert len(real.map.crosswalks) == 4
    assert walks.area < 0.12 * shapely.union_all(_areas(real.map)).area
    assert shapely.contains_xy(walks, *on_road.T).mean() > 0.5


@pytest.mark.slow
def test_real_window(real: Recording, data: Path) -> None:
    part = crop_recording("log", real, (100.0, 110.0))
    assert part.frame_count == 101
    there = {track.id: track for track in _tracks(real) if track.valid[1000:1101].any()}
    assert {track.id for track in _tracks(part)} == set(there)
    for track in _tracks(part):
        np.testing.assert_array_equal(track.x, there[track.id].x[1000:1101])


def test_frames_start_with_the_first_of_both_tables(folder: Path) -> None:
    recording = read_interaction(folder, folder / "map.osm")
    first, truck, walker, cyclist = _tracks(recording)
    assert (recording.frame_count, recording.id) == (5, "map_vehicle_tracks_007")
    np.testing.assert_array_equal(first.valid, [False, True, True, False, True])
    np.testing.assert_array_equal(first.x, [np.nan, 1, 2, np.nan, 4])
    assert (truck.category, truck.length[2], truck.yaw[2]) == (ObjectCategory.TRUCK, 9, 3.1)
    assert (walker.category, cyclist.category) == (ObjectCategory.PEDESTRIAN, ObjectCategory.BICYCLE)
    assert np.isnan([walker.yaw, walker.length, walker.width]).all()
    assert recording.notes == ("1 of the pedestrian/bicycle tracks taken for bicycles by their speed",)


def test_a_window_keeps_the_frames_at_both_ends(folder: Path) -> None:
    part = crop_recording("log", read_interaction(folder, folder / "map.osm"), (0.1, 0.2))
    assert part.frame_count == 2
    assert [(track.id, track.valid.tolist()) for track in _tracks(part)] == [("1", [True, True]), ("2", [False, True])]


def test_nothing_is_warned_of(folder: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_interaction(folder / "vehicle_tracks_007.csv", folder / "map.osm")


# --- files as editors and version 1.2 write them ---
def test_a_byte_order_mark_is_not_part_of_the_first_column(folder: Path) -> None:
    for path in folder.glob("*.csv"):
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert [track.id for track in _tracks(read_interaction(folder, folder / "map.osm"))] == ["1", "2", "P1", "P2"]


CASES = (
    "1.0,1,1,100,car,1,2,10,0,0.1,4.5,1.8",
    "1.0,1,2,200,car,2,2,10,0,0.1,4.5,1.8",
    "1.0,2,1,100,pedestrian/bicycle,3,9,1,1,,,",
    "2.0,1,1,100,truck,7,2,10,0,0.1,9,2.5",
    "2.0,1,2,200,truck,8,2,10,0,0.1,9,2.5",
)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A table of version 1.2 where the data set has it, its map in a folder beside."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "train").mkdir()
    build_street().write(tmp_path / "maps" / "DR_X.osm")
    return write_table(tmp_path / "train" / "DR_X_train.csv", *CASES, header=f"case_id,{VEHICLES}")


def test_a_case_of_version_1_2_is_a_log(table: Path) -> None:
    assert list_cases(table) == ("1", "2")
    osm = find_interaction_map(table)
    assert osm == table.parents[1] / "maps" / "DR_X.osm"
    first, second = (read_interaction(table, osm, case=case) for case in ("1", "2"))
    assert (first.id, second.id) == ("DR_X_train_case1", "DR_X_train_case2")
    car, walker = _tracks(first)
    assert (car.id, car.category, car.x.tolist()) == ("1", ObjectCategory.CAR, [1, 2])
    assert walker.category is ObjectCategory.PEDESTRIAN
    assert np.isnan([walker.yaw, walker.length, walker.width]).all()
    assert [(track.category, track.x.tolist()) for track in _tracks(second)] == [(ObjectCategory.TRUCK, [7, 8])]


def test_a_table_of_one_case_needs_no_name_of_it(table: Path) -> None:
    write_table(table, *CASES[:3], header=f"case_id,{VEHICLES}")
    assert len(_tracks(read_interaction(table, find_interaction_map(table)))) == 2


@pytest.mark.parametrize(
    ("case", "words"),
    [("", "expected the name of one case, found 2 cases from 1 on"), ("9", "at least one row of the case 9")],
)
def test_cases_that_are_not_there(table: Path, case: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_interaction(table, find_interaction_map(table), case=case)


def test_a_case_of_a_table_without_cases(folder: Path) -> None:
    with pytest.raises(InputError, match="expected the column case_id, found track_id"):
        read_interaction(folder, folder / "map.osm", case="1")


def test_a_map_of_another_place_is_not_taken(table: Path) -> None:
    with pytest.raises(InputError, match=r"expected one Lanelet2 map \*\.osm beside the tracks .* found 0"):
        find_interaction_map(table.rename(table.with_name("DR_Y_train.csv")))


# --- damaged files ---
def _rows(*rows: str, header: str = VEHICLES) -> Callable[[Path], object]:
    return lambda folder: write_table(folder / "vehicle_tracks_007.csv", *rows, header=header)


GOOD = "1,5,500,car,1,2,10,0,0.1,4.5,1.8"


TABLES: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (lambda folder: (folder / "vehicle_tracks_007.csv").write_text(""), "column track_id, found none"),
    "no rows": (_rows(), "expected at least one row, found none"),
    "no column": (
        _rows(GOOD, header=VEHICLES.replace("psi_rad", "heading")),
        "expected the column psi_rad, found track",
    ),
    "short row": (_rows(GOOD, "1,6,600,car,2"), "line 3: expected 11 columns, found 5"),
    "NaN": (_rows(GOOD.replace(",2,", ",nan,")), "line 2: y: expected a finite number, found 'nan'"),
    "a word": (_rows(GOOD.replace("0.1", "north")), "line 2: psi_rad: expected a finite number, found 'north'"),
    "no size": (_rows(GOOD.replace("1.8", "0")), "line 2: width: expected a positive number, found '0'"),
    "off the clock": (
        _rows(GOOD, "1,6,640,car,2,2,10,0,0.1,4.5,1.8"),
        "line 3: timestamp_ms: expected a multiple of 100",
    ),
    "twice": (_rows(GOOD, GOOD), "track 1: expected one row at 500 ms, found 2"),
    "type": (_rows(GOOD.replace("car", "tram")), "line 2: agent_type: expected one of car, truck"),
    "no text": (
        lambda folder: (folder / "vehicle_tracks_007.csv").write_bytes(b"\xff\xfe\x00"),
        "comma-separated values",
    ),
    "no file": (lambda folder: (folder / "vehicle_tracks_007.csv").unlink(), "expected one vehicle_tracks_*.csv"),
    "several": (lambda folder: (folder / "vehicle_tracks_008.csv").write_text(""), "(name one of several), found 2"),
}


@pytest.mark.parametrize("name", TABLES)
def test_damaged_tables(folder: Path, name: str) -> None:
    damage, words = TABLES[name]
    damage(folder)
    with pytest.raises(InputError) as error:
        read_interaction(folder, folder / "map.osm")
    assert words in str(error.value)
    assert str(folder) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((0.3, 9.0), "expected a window within 0 s to 0.4 s, found 0.3 s to 9 s"),
        ((0.2, 0.1), "found 0.2 s to 0.1 s"),
        ((-1.0, 0.1), "found -1 s to 0.1 s"),
        ((math.nan, 0.1), "found nan s to 0.1 s"),
    ],
)
def test_a_window_outside_the_log(folder: Path, window: tuple[float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        crop_recording("log", read_interaction(folder, folder / "map.osm"), window)


def test_a_missing_table_file(folder: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_interaction(folder / "vehicle_tracks_009.csv", folder / "map.osm")
