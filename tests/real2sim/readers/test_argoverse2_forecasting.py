"""Argoverse 2 motion forecasting: small scenarios with known answers, damaged scenarios and maps."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet
from testing.argoverse2_samples import (
    ALL,
    AV,
    SCENARIOS,
    Rows,
    archive,
    draw_line,
    index_tracks,
    joined,
    log,
    no_fixture_check,
    segment,
    track_rows,
    write_map,
)

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import LaneKind
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.recording import ObjectCategory


def scenario(folder: Path, rows: Rows | None = None, lanes: Any = None) -> Path:
    write_map(folder, lanes or archive())
    parquet.write_table(pa.table(rows or track_rows("AV", "vehicle", ALL)), folder / "scenario_s1.parquet")
    return folder


@pytest.mark.parametrize(
    ("type_", "category"),
    [
        ("vehicle", ObjectCategory.CAR),
        ("bus", ObjectCategory.BUS),
        ("motorcyclist", ObjectCategory.MOTORCYCLE),
        ("cyclist", ObjectCategory.BICYCLE),
        ("pedestrian", ObjectCategory.PEDESTRIAN),
        ("static", ObjectCategory.STATIC),
        ("riderless_bicycle", ObjectCategory.STATIC),
        ("construction", ObjectCategory.STATIC),
    ],
)
def test_types_of_a_scenario_become_categories(tmp_path: Path, type_: str, category: ObjectCategory) -> None:
    track = index_tracks(read_argoverse2(scenario(tmp_path, track_rows("7", type_, ALL))))["7"]
    assert (track.category, track.parked) == (category, category is ObjectCategory.STATIC)


@given(timesteps=st.sets(st.integers(0, 9), min_size=1), order=st.randoms())
@no_fixture_check
def test_rows_of_a_scenario_fall_into_their_frames(tmp_path: Path, timesteps: set[int], order: Any) -> None:
    shuffled = list(timesteps)
    order.shuffle(shuffled)
    rows = joined(track_rows("7", "vehicle", tuple(shuffled)), track_rows("AV", "vehicle", ALL))
    track = index_tracks(read_argoverse2(scenario(tmp_path, rows)))["7"]
    assert track.valid_frames.tolist() == sorted(timesteps)
    assert track.x[track.valid].tolist() == [5.0 + step for step in sorted(timesteps)]
    assert np.isnan(np.concatenate((track.x[~track.valid], track.yaw[~track.valid], track.length))).all()


def test_what_a_scenario_does_not_say_is_noted(tmp_path: Path) -> None:
    rows = joined(track_rows("1", "vehicle", ALL), track_rows("2", "unknown", ALL), track_rows("3", "unknown", ALL))
    recording = read_argoverse2(scenario(tmp_path, rows))
    assert recording.cavs == ()
    assert any("2 tracks of type unknown" in note for note in recording.notes)
    assert any("no track AV" in note for note in recording.notes)


def test_the_map_keeps_what_the_source_says(tmp_path: Path) -> None:
    lanes = {
        "1": segment(0.0, successors=[2, 99], predecessors=[3], left_neighbor_id=4, right_neighbor_id=5),
        "4": segment(
            4.0, left_lane_boundary=draw_line(2.0, (40.0, 0.0)), right_lane_boundary=draw_line(6.0, (40.0, 0.0))
        ),
        "5": segment(-4.0, lane_type="BIKE", is_intersection=True, centerline=draw_line(-4.5)),
        "6": segment(8.0, lane_type="BUS"),
        "7": segment(9.0, lane_type="TRAMWAY"),
        "8": segment(9.0, left_lane_boundary=draw_line(9.0, (3.0, 3.0))),
    }
    crossings = {
        "1": {"edge1": draw_line(0.0, (1.0, 5.0)), "edge2": draw_line(3.0, (1.0, 5.0))},
        "2": {"edge1": draw_line(0.0, (1.0, 5.0)), "edge2": draw_line(3.0, (5.0, 1.0))},
    }
    raw = archive(lane_segments=lanes, pedestrian_crossings=crossings)
    recording = read_argoverse2(scenario(tmp_path, lanes=raw))
    read = recording.map.lanes
    assert set(read) == {"1", "4", "5", "6"}
    assert (read["1"].exits, read["1"].entries) == (("2", "99"), ("3",))
    assert (read["1"].left_neighbour, read["1"].right_neighbour) == ("", "5")  # lane 4 leads the other way
    assert np.ptp(read["1"].centre[:, 1]) == 0.0 == read["1"].centre[0, 1]
    assert read["1"].centre[[0, -1], 0].tolist() == [0.0, 40.0]
    assert (read["5"].kind, read["5"].junction, read["5"].centre[0, 1]) == (LaneKind.BIKE, True, -4.5)
    assert (read["6"].kind, read["6"].junction) == (LaneKind.DRIVING, False)
    for ring in recording.map.crosswalks:
        assert shapely.Polygon(ring).area == pytest.approx(12.0)
    assert any("2 lane segments" in note for note in recording.notes)


@pytest.mark.parametrize(("rows", "message"), SCENARIOS)
def test_bad_scenarios_are_refused(tmp_path: Path, rows: Rows, message: str) -> None:
    with pytest.raises(InputError, match=rf"scenario_s1\.parquet: {message}"):
        read_argoverse2(scenario(tmp_path, rows))


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ("{", "EOF while parsing"),
        ([], "expected an object"),
        ({}, "lane_segments: Field required"),
        ({"lane_segments": {}}, "lane_segments: Dictionary should have at least 1 item"),
        (archive(lane_segments={"1": segment(0.0, lane_type="TRAMWAY")}), "expected at least one that is a lane"),
        (archive(lane_segments={"1": segment(0.0, successors=3)}), r"lane_segments\.1\.successors: .* found 3"),
        (archive(lane_segments={"1": {}}), r"lane_segments\.1\.lane_type: Field required"),
        (
            archive(lane_segments={"1": segment(0.0, left_lane_boundary=[{"x": math.nan, "y": 0.0}] * 2)}),
            r"left_lane_boundary\.0\.x: expected a finite number, found NaN",
        ),
        (archive(pedestrian_crossings={"9": {"edge1": [], "edge2": []}}), r"pedestrian_crossings\.9\.edge1"),
    ],
)
def test_bad_maps_are_refused(tmp_path: Path, raw: Any, message: str) -> None:
    scenario(tmp_path)
    write_map(tmp_path, raw)
    with pytest.raises(InputError, match=rf"log_map_archive_x\.json: .*{message}") as caught:
        read_argoverse2(tmp_path)
    assert "\n" not in str(caught.value)


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder of Argoverse 2, found none"):
        read_argoverse2(tmp_path / "absent")
    with pytest.raises(InputError, match=r"expected scenario_\*\.parquet or annotations\.feather .* found neither"):
        read_argoverse2(tmp_path)
    (log(tmp_path) / "map" / "log_map_archive_x.json").unlink()
    with pytest.raises(InputError, match=r"map: expected log_map_archive_\*\.json, found none"):
        read_argoverse2(tmp_path)
    (tmp_path / "city_SE3_egovehicle.feather").unlink()
    with pytest.raises(InputError, match=r"city_SE3_egovehicle\.feather: expected a feather table, found no such file"):
        read_argoverse2(tmp_path)
    (tmp_path / "annotations.feather").rename(tmp_path / "other.feather")
    with pytest.raises(InputError, match=r"expected annotations_with_ego\.feather or annotations\.feather, found none"):
        read_argoverse2(tmp_path)


def test_a_file_in_place_of_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder of Argoverse 2, found a file"):
        read_argoverse2(scenario(tmp_path) / "scenario_s1.parquet")


def test_two_scenarios_in_one_folder_are_refused(tmp_path: Path) -> None:
    parquet.write_table(pa.table(AV), scenario(tmp_path) / "scenario_s2.parquet")
    with pytest.raises(InputError, match=r"expected one scenario_\*\.parquet, found 2, such as scenario_s1"):
        read_argoverse2(tmp_path)


@pytest.mark.parametrize("name", ["scenario_s1.parquet", "annotations.feather", "city_SE3_egovehicle.feather"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_tables_are_refused_in_one_sentence(tmp_path: Path, name: str, share: float) -> None:
    path = (scenario if name.endswith("parquet") else log)(tmp_path) / name
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=rf"^[^\n]*{name}: expected a complete (parquet|feather) table, found[^\n]+$"):
        read_argoverse2(tmp_path)
