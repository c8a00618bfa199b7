"""Argoverse 2 sensor logs: boxes in the ego frame, poses of the ego and the map become a recording.

Source: Wilson et al., Argoverse 2, NeurIPS Datasets 2021. `city_SE3_egovehicle` takes the ego frame, whose origin is
the middle of the rear axle, to the city frame; quaternions are (w, x, y, z), sizes are full ones, times nanoseconds.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Int, wrap_angles
from real2sim.readers.argoverse2_map import read_map, the_file
from real2sim.readers.argoverse2_poses import POSE, Poses, poses, seconds
from real2sim.readers.arrow_tables import Columns, read_columns
from real2sim.readers.shapes import moved_ahead
from real2sim.recording import Category, Recording, Track, View

EGO_BOX = "EGO_VEHICLE"
EGO = "AV"
"""Id of the ego's track, as in the forecasting part of the data set."""
AXLE_TO_CENTRE_M = 1.425
"""From the ego's rear axle to its box centre: half the wheelbase (2.85 m) of a Ford Fusion, its overhangs being about
alike. In the log at hand the pose slips sideways in bends as a point 0.1 m behind the axle would, not as a centre."""
DT_S = 0.1
HOLD_S = 0.055
"""A box is taken to stand where it was last seen for about half a frame at most."""
STILL_M = 1.0
"""A two-wheeler that stays within this distance all the time has no rider."""

CATEGORIES: Mapping[str, Category] = {
    "REGULAR_VEHICLE": Category.CAR,
    "LARGE_VEHICLE": Category.TRUCK,
    "BOX_TRUCK": Category.TRUCK,
    "TRUCK": Category.TRUCK,
    "TRUCK_CAB": Category.TRUCK,
    "VEHICULAR_TRAILER": Category.TRUCK,
    "BUS": Category.BUS,
    "SCHOOL_BUS": Category.BUS,
    "ARTICULATED_BUS": Category.BUS,
    "MOTORCYCLE": Category.MOTORCYCLE,
    "MOTORCYCLIST": Category.MOTORCYCLE,
    "BICYCLE": Category.BICYCLE,
    "BICYCLIST": Category.BICYCLE,
    "WHEELED_DEVICE": Category.BICYCLE,
    "WHEELED_RIDER": Category.BICYCLE,
    "PEDESTRIAN": Category.PEDESTRIAN,
    "OFFICIAL_SIGNALER": Category.PEDESTRIAN,
    "STROLLER": Category.PEDESTRIAN,
    "WHEELCHAIR": Category.PEDESTRIAN,
    "BOLLARD": Category.STATIC,
    "CONSTRUCTION_BARREL": Category.STATIC,
    "CONSTRUCTION_CONE": Category.STATIC,
    "SIGN": Category.STATIC,
    "STOP_SIGN": Category.STATIC,
    "MOBILE_PEDESTRIAN_CROSSING_SIGN": Category.STATIC,
    "MESSAGE_BOARD_TRAILER": Category.STATIC,
    "TRAFFIC_LIGHT_TRAILER": Category.STATIC,
}
RIDERS: Mapping[str, str] = {
    "BICYCLIST": "BICYCLE",
    "MOTORCYCLIST": "MOTORCYCLE",
    "WHEELED_RIDER": "WHEELED_DEVICE",
}
"""The source boxes a rider and what they ride apart."""


RIDDEN_M = 1.5
"""A rider this close to a two-wheeler, half of the time, rides it."""


@dataclass(frozen=True)
class Boxes:
    """All boxes of a log in the city frame, a row a box: (N,) each."""

    id: npt.NDArray[np.str_]
    word: npt.NDArray[np.str_]
    t: Float
    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float


def read_argoverse2_sensor(folder: Path) -> Recording:
    """Reads the annotations, the ego's poses and `map/` of a log folder onto a 10 Hz grid; raises InputError.

    The recording car (track "AV") is the connected vehicle; where the annotations have a box of it, its size is taken.
    """
    path = the_file(folder, "annotations_with_ego.feather", "annotations.feather")
    rows = read_columns(path, (*POSE, "length_m", "width_m"), ("track_uuid", "category"))
    start_ns = int(rows["timestamp_ns"].min())
    ego = _ego(folder / "city_SE3_egovehicle.feather", rows["timestamp_ns"], start_ns)
    boxes = _boxes(path, rows, ego, start_ns)
    grid = DT_S * np.arange(round(float(boxes.t.max()) / DT_S) + 1, dtype=np.float64)
    if len(grid) < 2:
        raise InputError(f"{path}: timestamp_ns: expected at least 2 sweeps, found {len(np.unique(boxes.t))}")
    tracks, notes = _tracks(path, boxes, grid)
    hd_map, map_notes = read_map(folder / "map")
    own, own_notes = _own_track(boxes, ego.at(grid))
    return Recording(
        id=folder.resolve().name,
        source="argoverse2",
        dt_s=DT_S,
        frames=len(grid),
        views=(View("log", (own, *tracks)),),
        map=hd_map,
        cavs=(EGO,),
        notes=(*own_notes, *notes, *map_notes),
    )


def _ego(path: Path, sweeps_ns: Int, start_ns: int) -> Poses:
    found = poses(path, read_columns(path, POSE), start_ns)
    order = np.argsort(found.t, kind="stable")
    found = Poses(found.t[order], found.xyz[order], found.quaternion[order])
    end = float(seconds(sweeps_ns, start_ns).max())
    if found.t[0] > HOLD_S or found.t[-1] < end - HOLD_S:
        raise InputError(
            f"{path}: expected poses for all sweeps, 0 to {end:g} s after the first, "
            f"found them from {found.t[0]:g} to {found.t[-1]:g} s"
        )
    return found


def _boxes(path: Path, rows: Columns, ego: Poses, start_ns: int) -> Boxes:
    """City frame = pose of the ego at that time, times the box."""
    boxes = poses(path, rows, start_ns)
    frame = ego.at(boxes.t)
    turn = frame.rotation
    xyz = np.einsum("nij,nj->ni", turn, boxes.xyz) + frame.xyz
    ahead = np.einsum("nij,nj->ni", turn, boxes.rotation[:, :, 0])
    return Boxes(
        id=rows["track_uuid"],
        word=rows["category"],
        t=boxes.t,
        x=xyz[:, 0],
        y=xyz[:, 1],
        yaw=np.arctan2(ahead[:, 1], ahead[:, 0]),
        length=rows["length_m"],
        width=rows["width_m"],
    )


def _own_track(boxes: Boxes, ego: Poses) -> tuple[Track, tuple[str, ...]]:
    own = boxes.word == EGO_BOX
    turn = ego.rotation
    size = [
        np.full(len(ego.t), np.median(column[own]) if own.any() else np.nan) for column in (boxes.length, boxes.width)
    ]
    axle = Track(
        id=EGO,
        category=Category.CAR,
        valid=np.ones(len(ego.t), dtype=np.bool_),
        x=ego.xyz[:, 0],
        y=ego.xyz[:, 1],
        yaw=np.arctan2(turn[:, 1, 0], turn[:, 0, 0]),
        length=size[0],
        width=size[1],
    )
    moved = f"{EGO}: box centre taken as {AXLE_TO_CENTRE_M} m ahead of the pose, which is that of the rear axle"
    among = f"the ego is a box of the annotations too: its size is taken, its {own.sum()} rows are not"
    return moved_ahead(axle, AXLE_TO_CENTRE_M), (moved, among) if own.any() else (moved,)


def _tracks(path: Path, boxes: Boxes, grid: Float) -> tuple[tuple[Track, ...], tuple[str, ...]]:
    words = {str(id_): str(word) for id_, word in zip(boxes.id, boxes.word, strict=True) if word != EGO_BOX}
    passed_over = Counter(word for word in words.values() if word not in CATEGORIES)
    tracks = {id_: _track(path, boxes, id_, grid) for id_, word in words.items() if word in CATEGORIES}
    there = {id_: track for id_, track in tracks.items() if track.valid.any()}
    ridden = _ridden(there, words)
    kept = [_parked(track, words[id_], ridden) for id_, track in there.items() if id_ not in ridden]
    notes = [f"{count} tracks of the unknown category {word} passed over" for word, count in passed_over.items()]
    notes += [f"{len(ridden)} riders left out: the box of what they ride stands for both"] if ridden else []
    short = len(tracks) - len(there)
    notes += [f"{short} tracks without a box within {HOLD_S} s of a frame passed over"] if short else []
    return tuple(kept), tuple(notes)


def _track(path: Path, boxes: Boxes, id_: str, grid: Float) -> Track:
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
    category = CATEGORIES[str(boxes.word[rows[0]])]
    return Track(
        id=id_,
        category=category,
        valid=valid,
        x=x,
        y=y,
        yaw=wrap_angles(yaw),
        length=length,
        width=width,
        parked=category is Category.STATIC,
    )


def _ridden(tracks: Mapping[str, Track], words: Mapping[str, str]) -> dict[str, str]:
    """Riders with what they ride."""
    riders = {id_: RIDERS[words[id_]] for id_ in tracks if words[id_] in RIDERS}
    pairs = [
        (rider, id_)
        for rider, steed in riders.items()
        for id_ in tracks
        if words[id_] == steed and _close(tracks[rider], tracks[id_])
    ]
    return dict(reversed(pairs))


def _close(rider: Track, steed: Track) -> bool:
    with np.errstate(invalid="ignore"):
        near = np.hypot(rider.x - steed.x, rider.y - steed.y) <= RIDDEN_M
    return bool(2 * near.sum() >= rider.valid.sum())


def _parked(track: Track, word: str, ridden: Mapping[str, str]) -> Track:
    """A two-wheeler that nobody rides and that never moves: the source does not say whether it is parked."""
    if word not in RIDERS.values() or track.id in ridden.values():
        return track
    spread = np.hypot(np.ptp(track.x[track.valid]), np.ptp(track.y[track.valid]))
    if spread > STILL_M:
        return track
    return replace(track, category=Category.STATIC, parked=True)
