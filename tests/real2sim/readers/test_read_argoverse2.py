"""Argoverse 2: the real scenario and the real log, small ones with known answers, and damaged files."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import feather, parquet

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import LaneKind
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.readers.argoverse2_sensor import AXLE_TO_CENTRE_M
from real2sim.recording import ObjectCategory, RecordedTrack, Recording

Rows = dict[str, list[Any]]
no_fixture_check = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)


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


def _tracks(recording: Recording) -> dict[str, RecordedTrack]:
    (view,) = recording.views
    return {track.id: track for track in view.tracks}


def _raw_map(folder: Path) -> dict[str, Any]:
    (path,) = folder.glob("log_map_archive_*.json")
    return json.loads(path.read_text())


def _in_lanes(recording: Recording) -> tuple[Bool, Bool]:
    """Whether positions of moving vehicles lie in lanes, and whether in the part of the city that the map shows."""
    lanes = recording.map.lanes.values()
    area = shapely.union_all([shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))) for lane in lanes])
    vehicles = [track for track in _tracks(recording).values() if track.category.kind is Kind.VEHICLE]
    moving = [
        track.xy[track.valid_frames]
        for track in vehicles
        if np.hypot(*np.ptp(track.xy[track.valid_frames], axis=0)) > 5
    ]
    points = shapely.points(np.concatenate(moving))
    return shapely.contains(area, points), shapely.contains(area.convex_hull, points)


def test_everything_of_the_real_scenario_is_there(forecasting: Recording, forecasting_folder: Path) -> None:
    (path,) = forecasting_folder.glob("*.parquet")
    table = parquet.read_table(path).to_pylist()
    known = [row for row in table if row["object_type"] != "background"]
    tracks = _tracks(forecasting)
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


def test_everything_of_the_real_log_is_there(sensor: Recording, sensor_folder: Path) -> None:
    rows = feather.read_table(sensor_folder / "annotations_with_ego.feather").to_pylist()
    boxes = [row for row in rows if row["category"] != "EGO_VEHICLE"]
    tracks = _tracks(sensor)
    assert set(tracks) == {row["track_uuid"] for row in boxes} | {"AV"}
    assert (sensor.frame_count, sensor.dt_s, sensor.cavs) == (len({row["timestamp_ns"] for row in rows}), 0.1, ("AV",))
    for id_ in tracks.keys() - {"AV"}:
        assert tracks[id_].valid.sum() == sum(row["track_uuid"] == id_ for row in boxes)
    assert (tracks["AV"].length[0], tracks["AV"].width[0]) == (4.877, 2.0)
    assert tracks["AV"].valid.all()
    assert any("the ego is a box" in note for note in sensor.notes)
    assert set(sensor.map.lanes) == set(_raw_map(sensor_folder / "map")["lane_segments"])


def test_standing_things_stand_in_the_city_while_the_ego_drives(sensor: Recording) -> None:
    """Boxes are told in the frame of the ego: a wrong pose or quaternion would smear them."""
    tracks = _tracks(sensor)
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
    tracks = _tracks(forecasting)
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
    for track in _tracks(sensor).values():
        step = np.diff(track.xy, axis=0)
        fast = np.hypot(*step.T) > 0.3
        if track.category is ObjectCategory.CAR and fast.any():
            errors.append(wrap_angles(np.arctan2(step[:, 1], step[:, 0]) - track.yaw[1:])[fast])
    assert np.median(np.abs(np.concatenate(errors))) < math.radians(2)


# --- a small map ---


def _line(y: float, xs: tuple[float, ...] = (0.0, 20.0, 40.0)) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": 1.0} for x in xs]


def segment(y: float, **changes: Any) -> dict[str, Any]:
    return {
        "id": 1,
        "lane_type": "VEHICLE",
        "is_intersection": False,
        "left_lane_boundary": _line(y + 2),
        "right_lane_boundary": _line(y - 2),
        "left_lane_mark_type": "NONE",
        "predecessors": [],
        "successors": [],
        "left_neighbor_id": None,
        "right_neighbor_id": None,
    } | changes


def archive(**changes: Any) -> dict[str, Any]:
    return {"lane_segments": {"1": segment(0.0)}, "pedestrian_crossings": {}, "drivable_areas": {}} | changes


def write_map(folder: Path, what: Any) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "log_map_archive_x.json").write_text(what if isinstance(what, str) else json.dumps(what))


# --- small scenarios ---


def track_rows(id_: str, type_: str, timesteps: tuple[int, ...], x: float = 5.0) -> Rows:
    return {
        "track_id": [id_ for _ in timesteps],
        "object_type": [type_ for _ in timesteps],
        "scenario_id": ["s1" for _ in timesteps],
        "timestep": list(timesteps),
        "position_x": [x + step for step in timesteps],
        "position_y": [0.5 for _ in timesteps],
        "heading": [0.1 for _ in timesteps],
    }


def joined(*parts: Rows) -> Rows:
    return {name: [value for part in parts for value in part[name]] for name in parts[0]}


ALL = tuple(range(10))


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
    track = _tracks(read_argoverse2(scenario(tmp_path, track_rows("7", type_, ALL))))["7"]
    assert (track.category, track.parked) == (category, category is ObjectCategory.STATIC)


@given(timesteps=st.sets(st.integers(0, 9), min_size=1), order=st.randoms())
@no_fixture_check
def test_rows_of_a_scenario_fall_into_their_frames(tmp_path: Path, timesteps: set[int], order: Any) -> None:
    shuffled = list(timesteps)
    order.shuffle(shuffled)
    rows = joined(track_rows("7", "vehicle", tuple(shuffled)), track_rows("AV", "vehicle", ALL))
    track = _tracks(read_argoverse2(scenario(tmp_path, rows)))["7"]
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
        "4": segment(4.0, left_lane_boundary=_line(2.0, (40.0, 0.0)), right_lane_boundary=_line(6.0, (40.0, 0.0))),
        "5": segment(-4.0, lane_type="BIKE", is_intersection=True, centerline=_line(-4.5)),
        "6": segment(8.0, lane_type="BUS"),
        "7": segment(9.0, lane_type="TRAMWAY"),
        "8": segment(9.0, left_lane_boundary=_line(9.0, (3.0, 3.0))),
    }
    crossings = {
        "1": {"edge1": _line(0.0, (1.0, 5.0)), "edge2": _line(3.0, (1.0, 5.0))},
        "2": {"edge1": _line(0.0, (1.0, 5.0)), "edge2": _line(3.0, (5.0, 1.0))},
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


# --- small logs ---

SWEEPS = 12
START_NS = 315_971_916_960_141_000
STEP_NS = 99_700_000


def turned(yaw: float, pitch: float = 0.0) -> Float:
    """Quaternion w, x, y, z of a turn about z after one about y."""
    (a, b), (c, d) = ((math.cos(angle / 2), math.sin(angle / 2)) for angle in (yaw, pitch))
    return np.array((a * c, -b * d, a * d, b * c))


def ego_at(t: float) -> tuple[Float, float, float]:
    """Position, yaw and pitch of the rear axle at t [s]: it drives and turns."""
    return np.array((700.0 + 8 * t, 2000.0 + 2 * t, -20.0)), 0.4 + 0.3 * t, 0.05


def seen(t: float, x: float, y: float, yaw: float) -> dict[str, float]:
    """A box on the ground of the city as the ego tells it at t."""
    origin, ego_yaw, pitch = ego_at(t)
    about_z = np.array(
        ((math.cos(ego_yaw), math.sin(ego_yaw), 0), (-math.sin(ego_yaw), math.cos(ego_yaw), 0), (0, 0, 1))
    )
    about_y = np.array(((math.cos(pitch), 0, -math.sin(pitch)), (0, 1, 0), (math.sin(pitch), 0, math.cos(pitch))))
    place = about_y @ about_z @ (np.array((x, y, -20.0)) - origin)
    w, i, j, k = turned(0.0, -pitch)
    v = turned(yaw - ego_yaw)
    quaternion = (
        w * v[0] - i * v[1] - j * v[2] - k * v[3],
        w * v[1] + i * v[0] + j * v[3] - k * v[2],
        w * v[2] - i * v[3] + j * v[0] + k * v[1],
        w * v[3] + i * v[2] - j * v[1] + k * v[0],
    )
    names = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
    return dict(zip(names, (*quaternion, *place), strict=True))


Way = Callable[[float], tuple[float, float, float]]


def box_rows(id_: str, category: str, way: Way, sweeps: tuple[int, ...] = tuple(range(SWEEPS))) -> Rows:
    rows = [
        {
            "timestamp_ns": START_NS + i * STEP_NS,
            "track_uuid": id_,
            "category": category,
            "length_m": 4.5,
            "width_m": 2.0,
        }
        | seen(i * STEP_NS / 1e9, *way(i * STEP_NS / 1e9))
        for i in sweeps
    ]
    return {name: [row[name] for row in rows] for name in rows[0]}


def pose_rows(first: int = -20_000_000, last: int = SWEEPS * STEP_NS) -> Rows:
    rows = []
    for ns in range(first, last, 10_000_000):
        (x, y, z), yaw, pitch = ego_at(ns / 1e9)
        sign = -1.0 if ns % 30_000_000 else 1.0  # q and -q are the same turn
        w, i, j, k = sign * turned(yaw, pitch)
        rows.append(
            {"timestamp_ns": START_NS + ns, "qw": w, "qx": i, "qy": j, "qz": k, "tx_m": x, "ty_m": y, "tz_m": z}
        )
    return {name: [row[name] for row in rows] for name in rows[0]}


def standing(x: float, y: float = 2010.0, yaw: float = 1.0) -> Way:
    return lambda t: (x, y, yaw)


CAR = box_rows("car", "REGULAR_VEHICLE", standing(720.0))


def log(folder: Path, *boxes: Rows, poses: Rows | None = None, name: str = "annotations.feather") -> Path:
    write_map(folder / "map", archive())
    feather.write_feather(pa.table(joined(*(boxes or (CAR,)))), folder / name)
    feather.write_feather(pa.table(poses or pose_rows()), folder / "city_SE3_egovehicle.feather")
    return folder


@given(x=st.floats(600, 800), y=st.floats(1900, 2100), yaw=st.floats(-math.pi, math.pi))
@no_fixture_check
def test_boxes_come_from_the_egos_frame_into_the_citys(tmp_path: Path, x: float, y: float, yaw: float) -> None:
    track = _tracks(read_argoverse2(log(tmp_path, box_rows("car", "BUS", standing(x, y, yaw)))))["car"]
    assert track.valid.all()
    np.testing.assert_allclose(track.xy, np.tile((x, y), (len(track.x), 1)), atol=2e-3)  # of interpolated poses
    np.testing.assert_allclose(wrap_angles(track.yaw - yaw), 0.0, atol=2e-4)
    assert (track.category, track.length[0], track.width[0]) == (ObjectCategory.BUS, 4.5, 2.0)


def test_sweeps_come_onto_a_grid_of_10_hz(tmp_path: Path) -> None:
    """A car at 20 m/s on a clock that is 0.3 % fast: rows by number instead of by time would be 0.06 m off a sweep."""
    car = box_rows("car", "REGULAR_VEHICLE", lambda t: (720.0 + 20 * t, 2000.0, 3.1 + 0.2 * t))
    recording = read_argoverse2(log(tmp_path, car))
    track, t = _tracks(recording)["car"], np.arange(recording.frame_count) * 0.1
    assert (recording.dt_s, recording.frame_count) == (0.1, SWEEPS)
    np.testing.assert_allclose(track.x[:-1], (720.0 + 20 * t)[:-1], atol=5e-3)
    np.testing.assert_allclose(wrap_angles(track.yaw - 3.1 - 0.2 * t), 0.0, atol=1e-3)  # it passes pi


def test_frames_without_a_sweep_are_not_made_up(tmp_path: Path) -> None:
    gaps = (2, 3, 4, 7, 8)
    recording = read_argoverse2(log(tmp_path, CAR, box_rows("7", "TRUCK", standing(730.0), gaps)))
    track = _tracks(recording)["7"]
    assert track.valid_frames.tolist() == list(gaps)
    assert np.isnan(track.x[~track.valid]).all()


def test_the_ego_is_the_connected_vehicle_at_its_box_centre(tmp_path: Path) -> None:
    recording = read_argoverse2(log(tmp_path))
    ego, t = _tracks(recording)["AV"], np.arange(recording.frame_count) * 0.1
    yaw = 0.4 + 0.3 * t
    np.testing.assert_allclose(ego.x, 700.0 + 8 * t + AXLE_TO_CENTRE_M * np.cos(yaw), atol=2e-3)
    np.testing.assert_allclose(ego.y, 2000.0 + 2 * t + AXLE_TO_CENTRE_M * np.sin(yaw), atol=2e-3)
    np.testing.assert_allclose(ego.yaw, yaw, atol=1e-4)
    assert recording.cavs == ("AV",)
    assert np.isnan(ego.length).all()


def test_the_box_of_the_ego_gives_its_size_only(tmp_path: Path) -> None:
    own = box_rows("uuid", "EGO_VEHICLE", lambda t: (*ego_at(t)[0][:2], ego_at(t)[1]))
    recording = read_argoverse2(log(tmp_path, CAR, own, name="annotations_with_ego.feather"))
    assert set(_tracks(recording)) == {"AV", "car"}
    assert _tracks(recording)["AV"].length.tolist() == [4.5] * recording.frame_count
    assert any("the ego is a box" in note for note in recording.notes)


def test_annotations_with_the_ego_are_preferred(tmp_path: Path) -> None:
    log(tmp_path)
    log(tmp_path, box_rows("other", "REGULAR_VEHICLE", standing(720.0)), name="annotations_with_ego.feather")
    assert set(_tracks(read_argoverse2(tmp_path))) == {"AV", "other"}


def test_riders_and_what_they_ride_are_one(tmp_path: Path) -> None:
    def riding(t: float) -> tuple[float, float, float]:
        return 720.0 + 4 * t, 2010.0, 0.0

    boxes = (
        box_rows("bike", "BICYCLE", riding),
        box_rows("rider", "BICYCLIST", lambda t: (riding(t)[0] - 0.2, 2010.1, 0.0)),
        box_rows("lone rider", "BICYCLIST", standing(760.0)),
        box_rows("parked", "BICYCLE", standing(750.0)),
        box_rows("held", "BICYCLE", standing(770.0)),
        box_rows("waiting", "BICYCLIST", standing(770.5)),
        box_rows("rolling", "WHEELED_DEVICE", lambda t: (780.0 + t * 3, 2010.0, 0.0)),
    )
    recording = read_argoverse2(log(tmp_path, *boxes))
    found = {id_: (track.category, track.parked) for id_, track in _tracks(recording).items() if id_ != "AV"}
    assert found == {
        "bike": (ObjectCategory.BICYCLE, False),
        "lone rider": (ObjectCategory.BICYCLE, False),
        "parked": (ObjectCategory.STATIC, True),
        "held": (ObjectCategory.BICYCLE, False),
        "rolling": (ObjectCategory.BICYCLE, False),
    }
    assert any("2 riders" in note for note in recording.notes)


def test_unknown_categories_are_noted(tmp_path: Path) -> None:
    recording = read_argoverse2(log(tmp_path, CAR, box_rows("dog", "DOG", standing(730.0))))
    assert set(_tracks(recording)) == {"AV", "car"}
    assert any("1 tracks of the unknown category DOG" in note for note in recording.notes)


# --- bad input ---


def _changed(rows: Rows, name: str, value: Any, row: int = 3) -> Rows:
    return rows | {name: [value if i == row else old for i, old in enumerate(rows[name])]}


def _without(rows: Rows, name: str) -> Rows:
    return {other: column for other, column in rows.items() if other != name}


AV = track_rows("AV", "vehicle", ALL)
SCENARIOS: list[tuple[Rows, str]] = [
    (_without(AV, "heading"), "expected the column heading, found track_id"),
    (_without(AV, "track_id"), "expected the column track_id"),
    ({name: [] for name in AV}, "expected at least one row, found an empty table"),
    (_changed(AV, "position_x", math.nan), "position_x: expected finite numbers, found nan in row 3"),
    (_changed(AV, "heading", None), "heading: expected finite numbers, found nan in row 3"),
    (AV | {"position_y": ["north"] * 10}, "position_y: expected numbers, found string"),
    (_changed(AV, "timestep", 4), "track AV: expected one row a timestep, found 10 for 9"),
    (_changed(AV, "timestep", -1), "timestep: expected frames 0 to .* found -1 to 9"),
    (_changed(AV, "timestep", 10**9), "timestep: expected frames 0 to .* found 0 to 1000000000"),
    (track_rows("AV", "vehicle", (0,)), "timestep: expected frames 0 to .* found 0 to 0"),
    (track_rows("AV", "unknown", ALL), "object_type: expected at least one known type, found unknown"),
]


@pytest.mark.parametrize(("rows", "message"), SCENARIOS)
def test_bad_scenarios_are_refused(tmp_path: Path, rows: Rows, message: str) -> None:
    with pytest.raises(InputError, match=rf"scenario_s1\.parquet: {message}"):
        read_argoverse2(scenario(tmp_path, rows))


HALF = {name: column[:60] for name, column in pose_rows().items()}
LOGS: list[tuple[Rows, Rows, str]] = [
    (_without(CAR, "qz"), pose_rows(), r"annotations\.feather: expected the column qz"),
    (CAR, _without(pose_rows(), "tx_m"), r"egovehicle\.feather: expected the column tx_m"),
    (_changed(CAR, "tx_m", math.inf), pose_rows(), r"annotations\.feather: tx_m: .* found inf in row 3"),
    (_changed(CAR, "qw", 7.0), pose_rows(), r"annotations\.feather: qw, .* length 1, found 7\.\d+ in row 3"),
    (CAR, _changed(pose_rows(), "ty_m", math.nan), r"egovehicle\.feather: ty_m: .* found nan in row 3"),
    (joined(CAR, CAR), pose_rows(), "track car: expected one box a sweep, found two at 0 s"),
    (box_rows("car", "TRUCK", standing(720.0), (0,)), pose_rows(), "expected at least 2 sweeps, found 1"),
    (CAR, HALF, r"egovehicle\.feather: expected poses for all sweeps, 0 to 1\.0967 s .* from -0\.02 to 0\.57 s"),
]


@pytest.mark.parametrize(("boxes", "poses", "message"), LOGS)
def test_bad_logs_are_refused(tmp_path: Path, boxes: Rows, poses: Rows, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_argoverse2(log(tmp_path, boxes, poses=poses))


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ("{", "EOF while parsing"),
        ([], "Input should be an object"),
        ({}, "lane_segments: Field required"),
        ({"lane_segments": {}}, "lane_segments: Dictionary should have at least 1 item"),
        (archive(lane_segments={"1": segment(0.0, lane_type="TRAMWAY")}), "expected at least one that is a lane"),
        (archive(lane_segments={"1": segment(0.0, successors=3)}), r"lane_segments\.1\.successors: .* found 3"),
        (archive(lane_segments={"1": {}}), r"lane_segments\.1\.lane_type: Field required"),
        (
            archive(lane_segments={"1": segment(0.0, left_lane_boundary=[{"x": math.nan, "y": 0.0}] * 2)}),
            r"left_lane_boundary\.0\.x: Input should be a finite number, found NaN",
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
