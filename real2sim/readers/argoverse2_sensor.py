"""Argoverse 2 sensor logs: read boxes in the ego frame, poses of the ego and the map.

Source: Wilson et al., Argoverse 2, NeurIPS Datasets 2021. `city_SE3_egovehicle` maps the ego frame, whose origin is the
middle of the rear axle, to the city frame; quaternions are (w, x, y, z), sizes are full, times in nanoseconds.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Int, wrap_angles
from real2sim.readers.argoverse2_map import find_single_file, read_argoverse2_map
from real2sim.readers.input_checks import check_frame_count
from real2sim.readers.map_geometry import shift_ahead
from real2sim.readers.tables import Columns, read_columns
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

POSE_COLUMNS = ("timestamp_ns", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
MAX_TIME_NS = 4e18
"""[ns] since 1970, 126 years: the difference of two such times still is an int64."""
EGO_TYPE = "EGO_VEHICLE"
EGO_ID = "AV"
"""Track id of the ego, as in the forecasting part of the data set."""
AXLE_TO_CENTRE_M = 1.425
"""From the ego's rear axle to its box centre: half the wheelbase (2.85 m) of a Ford Fusion with nearly equal overhangs.
In the available log the pose slips sideways in bends like a point 0.1 m behind the axle, unlike a centre.
"""
DT_S = 0.1
"""[s] Boxes are annotated 10 times a second."""
HOLD_S = 0.055
"""[s] The last box is held for about half a frame at most."""
STILL_M = 1.0
"""[m] A two-wheeler that stays within this distance has no rider."""

CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "REGULAR_VEHICLE": ObjectCategory.CAR,
    "LARGE_VEHICLE": ObjectCategory.TRUCK,
    "BOX_TRUCK": ObjectCategory.TRUCK,
    "TRUCK": ObjectCategory.TRUCK,
    "TRUCK_CAB": ObjectCategory.TRUCK,
    "VEHICULAR_TRAILER": ObjectCategory.TRUCK,
    "BUS": ObjectCategory.BUS,
    "SCHOOL_BUS": ObjectCategory.BUS,
    "ARTICULATED_BUS": ObjectCategory.BUS,
    "MOTORCYCLE": ObjectCategory.MOTORCYCLE,
    "MOTORCYCLIST": ObjectCategory.MOTORCYCLE,
    "BICYCLE": ObjectCategory.BICYCLE,
    "BICYCLIST": ObjectCategory.BICYCLE,
    "WHEELED_DEVICE": ObjectCategory.BICYCLE,
    "WHEELED_RIDER": ObjectCategory.BICYCLE,
    "PEDESTRIAN": ObjectCategory.PEDESTRIAN,
    "OFFICIAL_SIGNALER": ObjectCategory.PEDESTRIAN,
    "STROLLER": ObjectCategory.PEDESTRIAN,
    "WHEELCHAIR": ObjectCategory.PEDESTRIAN,
    "BOLLARD": ObjectCategory.STATIC,
    "CONSTRUCTION_BARREL": ObjectCategory.STATIC,
    "CONSTRUCTION_CONE": ObjectCategory.STATIC,
    "SIGN": ObjectCategory.STATIC,
    "STOP_SIGN": ObjectCategory.STATIC,
    "MOBILE_PEDESTRIAN_CROSSING_SIGN": ObjectCategory.STATIC,
    "MESSAGE_BOARD_TRAILER": ObjectCategory.STATIC,
    "TRAFFIC_LIGHT_TRAILER": ObjectCategory.STATIC,
}
MOUNT_BY_RIDER: Mapping[str, str] = {
    "BICYCLIST": "BICYCLE",
    "MOTORCYCLIST": "MOTORCYCLE",
    "WHEELED_RIDER": "WHEELED_DEVICE",
}
"""The source annotates riders and two-wheelers separately."""


RIDDEN_M = 1.5
"""[m] A rider this close to a two-wheeler for half of the time rides it."""


@dataclass(frozen=True)
class PoseSeries:
    """Positions and rotations of a box or of the ego at times (N,) [s]."""

    t: Float
    xyz: Float
    """Positions (N, 3) [m] in the frame of the table."""
    quaternion: Float
    """(N, 4) unit quaternions w, x, y, z."""

    def interpolate(self, t: Float) -> "PoseSeries":
        """Interpolate linearly and normalise the quaternions, which is accurate enough over 10 ms."""
        signs = np.cumprod(np.where((self.quaternion[1:] * self.quaternion[:-1]).sum(1) < 0, -1.0, 1.0))
        smooth = self.quaternion * np.concatenate(((1.0,), signs))[:, None]
        xyz, mixed = (
            np.column_stack([np.interp(t, self.t, column) for column in rows.T]) for rows in (self.xyz, smooth)
        )
        return PoseSeries(t, xyz, mixed / np.linalg.norm(mixed, axis=1)[:, None])

    @property
    def rotation(self) -> Float:
        """Rotation matrices (N, 3, 3)."""
        w, x, y, z = self.quaternion.T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def parse_poses(path: Path, rows: Columns, start_ns: int) -> PoseSeries:
    """Return the poses of all rows of a table with times since `start_ns`; raise InputError."""
    quaternion = np.column_stack([rows[name] for name in POSE_COLUMNS[1:5]])
    length = np.linalg.norm(quaternion, axis=1)
    bad = np.abs(length - 1) > 0.01
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"{path}: qw, qx, qy, qz: expected quaternions of length 1, found {length[row]:g} in row {row}"
        )
    xyz = np.column_stack([rows[name] for name in POSE_COLUMNS[5:]]).astype(np.float64)
    return PoseSeries(to_seconds(check_times(path, rows), start_ns), xyz, quaternion / length[:, None])


def to_seconds(timestamp_ns: Int, start_ns: int) -> Float:
    """Return times [s] since a start; both are within `MAX_TIME_NS`."""
    return (timestamp_ns - start_ns).astype(np.float64) / 1e9


def check_times(path: Path, rows: Columns) -> Int:
    """Return the column `timestamp_ns` as integers whose differences do not overflow; raise InputError."""
    times = rows["timestamp_ns"]
    if (np.abs(times.astype(np.float64)) > MAX_TIME_NS).any():
        raise InputError(f"{path}: timestamp_ns: expected times within 126 years of 1970, found others")
    return times.astype(np.int64)


@dataclass(frozen=True)
class AnnotatedBoxes:
    """All boxes of a log in the city frame, one row per box: (N,) each."""

    id: npt.NDArray[np.str_]
    type_name: npt.NDArray[np.str_]
    t: Float
    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float


def read_argoverse2_sensor(folder: Path) -> Recording:
    """Read annotations, ego poses and `map/` of a log folder onto a 10 Hz grid; raise InputError.

    The recording car (track "AV") is the connected vehicle; its size is that of its annotated box, if there is one.
    """
    path = find_single_file(folder, "annotations_with_ego.feather", "annotations.feather")
    rows = read_columns(path, (*POSE_COLUMNS, "length_m", "width_m"), ("track_uuid", "category"))
    times = check_times(path, rows)
    start_ns = int(times.min())
    steps = float(times.max() - times.min()) / 1e9 / DT_S
    check_frame_count(f"{path}: timestamp_ns", steps + 1, len(set(rows["track_uuid"].tolist())))
    ego = _read_ego_poses(folder / "city_SE3_egovehicle.feather", times, start_ns)
    boxes = _build_boxes(path, rows, ego, start_ns)
    grid = DT_S * np.arange(round(float(boxes.t.max()) / DT_S) + 1, dtype=np.float64)
    if len(grid) < 2:
        raise InputError(f"{path}: timestamp_ns: expected at least 2 sweeps, found {len(np.unique(boxes.t))}")
    tracks, notes = _build_tracks(path, boxes, grid)
    hd_map, map_notes = read_argoverse2_map(folder / "map")
    own, own_notes = _build_ego_track(boxes, ego.interpolate(grid))
    return Recording(
        id=folder.resolve().name,
        source="argoverse2",
        dt_s=DT_S,
        frame_count=len(grid),
        views=(ObserverView("log", (own, *tracks)),),
        map=hd_map,
        cavs=(EGO_ID,),
        notes=(*own_notes, *notes, *map_notes),
    )


def _read_ego_poses(path: Path, sweeps_ns: Int, start_ns: int) -> PoseSeries:
    poses = parse_poses(path, read_columns(path, POSE_COLUMNS), start_ns)
    order = np.argsort(poses.t, kind="stable")
    poses = PoseSeries(poses.t[order], poses.xyz[order], poses.quaternion[order])
    end = float(to_seconds(sweeps_ns, start_ns).max())
    if poses.t[0] > HOLD_S or poses.t[-1] < end - HOLD_S:
        raise InputError(
            f"{path}: expected poses for all sweeps, 0 to {end:g} s after the first, "
            f"found them from {poses.t[0]:g} to {poses.t[-1]:g} s"
        )
    return poses


def _build_boxes(path: Path, rows: Columns, ego: PoseSeries, start_ns: int) -> AnnotatedBoxes:
    """Transform boxes to the city frame: ego pose at that time, times box pose."""
    boxes = parse_poses(path, rows, start_ns)
    frame = ego.interpolate(boxes.t)
    turn = frame.rotation
    xyz = np.einsum("nij,nj->ni", turn, boxes.xyz) + frame.xyz
    ahead = np.einsum("nij,nj->ni", turn, boxes.rotation[:, :, 0])
    return AnnotatedBoxes(
        id=rows["track_uuid"],
        type_name=rows["category"],
        t=boxes.t,
        x=xyz[:, 0],
        y=xyz[:, 1],
        yaw=np.arctan2(ahead[:, 1], ahead[:, 0]),
        length=rows["length_m"],
        width=rows["width_m"],
    )


def _build_ego_track(boxes: AnnotatedBoxes, ego: PoseSeries) -> tuple[RecordedTrack, tuple[str, ...]]:
    own = boxes.type_name == EGO_TYPE
    turn = ego.rotation
    size = [
        np.full(len(ego.t), np.median(column[own]) if own.any() else np.nan) for column in (boxes.length, boxes.width)
    ]
    axle = RecordedTrack(
        id=EGO_ID,
        category=ObjectCategory.CAR,
        valid=np.ones(len(ego.t), dtype=np.bool_),
        x=ego.xyz[:, 0],
        y=ego.xyz[:, 1],
        yaw=np.arctan2(turn[:, 1, 0], turn[:, 0, 0]),
        length=size[0],
        width=size[1],
    )
    moved = f"{EGO_ID}: box centre taken as {AXLE_TO_CENTRE_M} m ahead of the pose, which is that of the rear axle"
    among = f"the ego is a box of the annotations too: its size is taken, its {own.sum()} rows are not"
    return shift_ahead(axle, AXLE_TO_CENTRE_M), (moved, among) if own.any() else (moved,)


def _build_tracks(path: Path, boxes: AnnotatedBoxes, grid: Float) -> tuple[tuple[RecordedTrack, ...], tuple[str, ...]]:
    words = {str(id_): str(word) for id_, word in zip(boxes.id, boxes.type_name, strict=True) if word != EGO_TYPE}
    skipped = Counter(word for word in words.values() if word not in CATEGORY_BY_TYPE)
    categories = {id_: CATEGORY_BY_TYPE[word] for id_, word in words.items() if word in CATEGORY_BY_TYPE}
    tracks = {id_: _build_track(path, boxes, id_, category, grid) for id_, category in categories.items()}
    there = {id_: track for id_, track in tracks.items() if track.valid.any()}
    ridden = _find_ridden(there, words)
    kept = [_mark_parked(track, words[id_], ridden) for id_, track in there.items() if id_ not in ridden]
    notes = [f"{count} tracks of the unknown category {word} skipped" for word, count in skipped.items()]
    notes += [f"{len(ridden)} riders left out: the box of what they ride stands for both"] if ridden else []
    short = len(tracks) - len(there)
    notes += [f"{short} tracks without a box within {HOLD_S} s of a frame skipped"] if short else []
    return tuple(kept), tuple(notes)


def _build_track(path: Path, boxes: AnnotatedBoxes, id_: str, category: ObjectCategory, grid: Float) -> RecordedTrack:
    rows = np.flatnonzero(boxes.id == id_)
    rows = rows[np.argsort(boxes.t[rows], kind="stable")]
    t = boxes.t[rows]
    if (np.diff(t) <= 0).any():
        raise InputError(
            f"{path}: track {id_}: expected one box a sweep, found two at {t[:-1][np.diff(t) <= 0][0]:g} s"
        )
    after = np.clip(np.searchsorted(t, grid), 0, len(t) - 1)
    valid = np.minimum(np.abs(t[after] - grid), np.abs(t[np.maximum(after - 1, 0)] - grid)) <= HOLD_S
    columns = (boxes.x[rows], boxes.y[rows], np.unwrap(boxes.yaw[rows]), boxes.length[rows], boxes.width[rows])
    x, y, yaw, length, width = (np.where(valid, np.interp(grid, t, column), np.nan) for column in columns)
    return RecordedTrack(
        id=id_,
        category=category,
        valid=valid,
        x=x,
        y=y,
        yaw=wrap_angles(yaw),
        length=length,
        width=width,
        parked=category is ObjectCategory.STATIC,
    )


def _find_ridden(tracks: Mapping[str, RecordedTrack], words: Mapping[str, str]) -> dict[str, str]:
    """Return rider id -> id of the two-wheeler."""
    riders = {id_: MOUNT_BY_RIDER[words[id_]] for id_ in tracks if words[id_] in MOUNT_BY_RIDER}
    pairs = [
        (rider, id_)
        for rider, steed in riders.items()
        for id_ in tracks
        if words[id_] == steed and _is_riding(tracks[rider], tracks[id_])
    ]
    return dict(reversed(pairs))


def _is_riding(rider: RecordedTrack, steed: RecordedTrack) -> bool:
    with np.errstate(invalid="ignore"):
        near = np.hypot(rider.x - steed.x, rider.y - steed.y) <= RIDDEN_M
    return bool(2 * near.sum() >= rider.valid.sum())


def _mark_parked(track: RecordedTrack, word: str, ridden: Mapping[str, str]) -> RecordedTrack:
    """Mark two-wheelers without a rider that never move as parked, which the source does not say."""
    if word not in MOUNT_BY_RIDER.values() or track.id in ridden.values():
        return track
    spread = np.hypot(np.ptp(track.x[track.valid]), np.ptp(track.y[track.valid]))
    if spread > STILL_M:
        return track
    return replace(track, category=ObjectCategory.STATIC, parked=True)
