"""Small Argoverse 2 folders for tests: tables of tracks and boxes, poses and maps."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from hypothesis import HealthCheck, settings
from pyarrow import feather

from mdrive_sumo.core.geometry import Float
from real2sim.recording import RecordedTrack, Recording

Rows = dict[str, list[Any]]


no_fixture_check = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)


def index_tracks(recording: Recording) -> dict[str, RecordedTrack]:
    (view,) = recording.views
    return {track.id: track for track in view.tracks}


# --- a small map ---
def draw_line(y: float, xs: tuple[float, ...] = (0.0, 20.0, 40.0)) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": 1.0} for x in xs]


def segment(y: float, **changes: Any) -> dict[str, Any]:
    return {
        "id": 1,
        "lane_type": "VEHICLE",
        "is_intersection": False,
        "left_lane_boundary": draw_line(y + 2),
        "right_lane_boundary": draw_line(y - 2),
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


# --- bad input ---
def change_value(rows: Rows, name: str, value: Any, row: int = 3) -> Rows:
    return rows | {name: [value if i == row else old for i, old in enumerate(rows[name])]}


def drop_column(rows: Rows, name: str) -> Rows:
    return {other: column for other, column in rows.items() if other != name}


AV = track_rows("AV", "vehicle", ALL)


SCENARIOS: list[tuple[Rows, str]] = [
    (drop_column(AV, "heading"), "expected the column heading, found track_id"),
    (drop_column(AV, "track_id"), "expected the column track_id"),
    ({name: [] for name in AV}, "expected at least one row, found an empty table"),
    (change_value(AV, "position_x", math.nan), "position_x: expected finite numbers, found nan in row 3"),
    (change_value(AV, "heading", None), "heading: expected finite numbers, found nan in row 3"),
    (AV | {"position_y": ["north"] * 10}, "position_y: expected numbers, found string"),
    (change_value(AV, "timestep", 4), "track AV: expected one row a timestep, found 10 for 9"),
    (change_value(AV, "timestep", -1), "timestep: expected frames 0 to .* found -1 to 9"),
    (change_value(AV, "timestep", 10**9), "timestep: expected frames 0 to .* found 0 to 1000000000"),
    (track_rows("AV", "vehicle", (0,)), "timestep: expected frames 0 to .* found 0 to 0"),
    (track_rows("AV", "unknown", ALL), "object_type: expected at least one known type, found unknown"),
]


HALF = {name: column[:60] for name, column in pose_rows().items()}
