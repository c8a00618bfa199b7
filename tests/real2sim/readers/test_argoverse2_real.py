"""Argoverse 2: a real scenario and a real log agree with their source."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyarrow import feather, parquet
from testing.argoverse2_samples import (
    index_tracks,
)

from mdrive_sumo.core.geometry import Bool, wrap_angles
from mdrive_sumo.core.state import Kind
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.recording import ObjectCategory, Recording


# --- the real scenario and the real log ---
@pytest.fixture(scope="module")
def forecasting_folder(shared_data: Path) -> Path:
    return shared_data / "real_logs" / "argoverse2" / "forecasting"


@pytest.fixture(scope="module")
def sensor_folder(shared_data: Path) -> Path:
    (folder,) = (shared_data / "real_logs" / "argoverse2" / "sensor").iterdir()
    return folder


@pytest.fixture(scope="module")
def forecasting(forecasting_folder: Path) -> Recording:
    return read_argoverse2(forecasting_folder)


@pytest.fixture(scope="module")
def sensor(sensor_folder: Path) -> Recording:
    return read_argoverse2(sensor_folder)


def _raw_map(folder: Path) -> dict[str, Any]:
    (path,) = folder.glob("log_map_archive_*.json")
    return json.loads(path.read_text())


def _in_lanes(recording: Recording) -> tuple[Bool, Bool]:
    """Whether positions of moving vehicles lie in lanes, and whether in the part of the city that the map shows."""
    lanes = recording.map.lanes.values()
    area = shapely.union_all([shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))) for lane in lanes])
    vehicles = [track for track in index_tracks(recording).values() if track.category.kind is Kind.VEHICLE]
    moving = [
        track.xy[track.valid_frames]
        for track in vehicles
        if np.hypot(*np.ptp(track.xy[track.valid_frames], axis=0)) > 5
    ]
    points = shapely.points(np.concatenate(moving))
    return np.asarray(shapely.contains(area, points)), np.asarray(shapely.contains(area.convex_hull, points))


def test_everything_of_the_real_scenario_is_there(forecasting: Recording, forecasting_folder: Path) -> None:
    (path,) = forecasting_folder.glob("*.parquet")
    table = parquet.read_table(path).to_pylist()
    known = [row for row in table if row["object_type"] != "background"]
    tracks = index_tracks(forecasting)
    assert set(tracks) == {row["track_id"] for row in known}
    assert forecasting.id == table[0]["scenario_id"]
    assert (forecasting.frame_count, forecasting.dt_s, forecasting.cavs) == (table[0]["num_timestamps"], 0.1, ("AV",))
    assert sum(track.valid.sum() for track in tracks.values()) == len(known)
    for row in known:
        track, at = tracks[row["track_id"]], row["timestep"]
        assert (track.x[at], track.y[at], track.yaw[at]) == (row["position_x"], row["position_y"], row["heading"])
        assert math.isnan(track.length[at])
    assert any("2 tracks of type background" in note for note in forecasting.notes)
    assert len(forecasting.map.lanes) == len(_raw_map(forecasting_folder)["lane_segments"])
    assert len(forecasting.map.crosswalks) == len(_raw_map(forecasting_folder)["pedestrian_crossings"])
    assert forecasting.map.left_hand is None


@pytest.mark.slow
def test_everything_of_the_real_log_is_there(sensor: Recording, sensor_folder: Path) -> None:
    rows = feather.read_table(sensor_folder / "annotations_with_ego.feather").to_pylist()
    boxes = [row for row in rows if row["category"] != "EGO_VEHICLE"]
    tracks = index_tracks(sensor)
    assert set(tracks) == {row["track_uuid"] for row in boxes} | {"AV"}
    assert (sensor.frame_count, sensor.dt_s, sensor.cavs) == (len({row["timestamp_ns"] for row in rows}), 0.1, ("AV",))
    for id_ in tracks.keys() - {"AV"}:
        assert tracks[id_].valid.sum() == sum(row["track_uuid"] == id_ for row in boxes)
    assert (tracks["AV"].length[0], tracks["AV"].width[0]) == (4.877, 2.0)
    assert tracks["AV"].valid.all()
    assert any("the ego is a box" in note for note in sensor.notes)
    assert set(sensor.map.lanes) == set(_raw_map(sensor_folder / "map")["lane_segments"])


def test_static_objects_stay_in_the_city_frame_while_the_ego_drives(sensor: Recording) -> None:
    """Boxes are told in the frame of the ego: a wrong pose or quaternion would smear them."""
    tracks = index_tracks(sensor)
    standing = [
        track for track in tracks.values() if track.category is ObjectCategory.STATIC and track.valid.sum() > 50
    ]
    ego = tracks["AV"]
    assert np.hypot(ego.x[-1] - ego.x[0], ego.y[-1] - ego.y[0]) > 30
    assert len(standing) > 5
    for track in standing:
        assert max(np.nanstd(track.x), np.nanstd(track.y)) < 0.25


@pytest.mark.parametrize("log", ["forecasting", "sensor"])
def test_real_vehicles_drive_on_lanes_where_the_map_has_any(log: str, request: pytest.FixtureRequest) -> None:
    in_lanes, mapped = _in_lanes(request.getfixturevalue(log))
    assert mapped.mean() > 0.65  # the others are farther away than the map reaches
    assert in_lanes[mapped].mean() > 0.93


@pytest.mark.parametrize(("log", "share"), [("forecasting", 0.90), ("sensor", 0.91)])
def test_links_of_real_lanes_resolve_and_meet(log: str, share: float, request: pytest.FixtureRequest) -> None:
    lanes = request.getfixturevalue(log).map.lanes
    links = [(lane, id_) for lane in lanes.values() for id_ in lane.exits + lane.entries]
    assert sum(id_ in lanes for _, id_ in links) >= share * len(links)  # the others lie beyond the map
    for lane, id_ in links:
        if id_ in lane.exits and id_ in lanes:
            assert math.dist(lane.centre[-1], lanes[id_].centre[0]) < 0.6
    for lane in lanes.values():
        for neighbour in filter(None, (lane.left_neighbour, lane.right_neighbour)):
            assert (lane.centre[-1] - lane.centre[0]) @ (lanes[neighbour].centre[-1] - lanes[neighbour].centre[0]) > 0


def test_velocity_by_differences_is_that_of_the_source(forecasting: Recording, forecasting_folder: Path) -> None:
    (path,) = forecasting_folder.glob("*.parquet")
    tracks = index_tracks(forecasting)
    differences = []
    for row in parquet.read_table(path).to_pylist():
        track, at = tracks.get(row["track_id"]), row["timestep"]
        if track is not None and 0 < at < forecasting.frame_count - 1 and track.category is ObjectCategory.CAR:
            velocity = (track.xy[at + 1] - track.xy[at - 1]) / 0.2
            differences.append(np.hypot(*(velocity - (row["velocity_x"], row["velocity_y"]))))
    assert np.nanmedian(differences) < 0.2
    assert np.nanquantile(differences, 0.95) < 2.5  # far tracks jitter; the source smooths its velocities


def test_headings_of_real_cars_are_those_of_their_way(sensor: Recording) -> None:
    errors = []
    for track in index_tracks(sensor).values():
        step = np.diff(track.xy, axis=0)
        fast = np.hypot(*step.T) > 0.3
        if track.category is ObjectCategory.CAR and fast.any():
            errors.append(wrap_angles(np.arctan2(step[:, 1], step[:, 0]) - track.yaw[1:])[fast])
    assert np.median(np.abs(np.concatenate(errors))) < math.radians(2)
