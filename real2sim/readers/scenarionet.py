"""ScenarioNet: read scenario descriptions (.pkl) of nuScenes, Waymo and nuPlan.

Source: Li et al., ScenarioNet, NeurIPS 2023, and its documentation of ScenarioDescription: `tracks[id].state` has
arrays with one row per frame, `map_features` the map, `dynamic_map_states` the traffic lights; metres, radians.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.readers.input_checks import check_frame_count, describe_value, parse_numbers
from real2sim.readers.map_geometry import shift_ahead
from real2sim.readers.safe_pickle import load_pickle
from real2sim.readers.scenarionet_map import build_scenarionet_map
from real2sim.readers.time_grid import TimeGrid, build_time_grid
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "VEHICLE": ObjectCategory.CAR,
    "CYCLIST": ObjectCategory.BICYCLE,
    "PEDESTRIAN": ObjectCategory.PEDESTRIAN,
    "TRAFFIC_CONE": ObjectCategory.STATIC,
    "TRAFFIC_BARRIER": ObjectCategory.STATIC,
    "TRAFFIC_OBJECT": ObjectCategory.STATIC,
}
CATEGORY_BY_NUSCENES_TYPE: Mapping[str, ObjectCategory] = {
    "vehicle.truck": ObjectCategory.TRUCK,
    "vehicle.construction": ObjectCategory.TRUCK,
    "vehicle.trailer": ObjectCategory.TRUCK,
    "vehicle.bus.rigid": ObjectCategory.BUS,
    "vehicle.bus.bendy": ObjectCategory.BUS,
    "vehicle.emergency.ambulance": ObjectCategory.VAN,
    "vehicle.motorcycle": ObjectCategory.MOTORCYCLE,
}
"""Track metadata of nuScenes are more specific than the track type."""
AXLE_TO_CENTRE_M = 1.385
"""From the rear axle to the box centre of nuScenes' Renault Zoe: 4.084 m long with a rear overhang of 0.657 m.

Its pose is that of the rear axle (nutonomy/nuscenes-devkit issue 108), and the converter keeps it.
"""


def read_scenarionet(path: Path) -> Recording:
    """Read one scenario description; raise InputError.

    The self-driving car (`sdc_id`) is the only connected vehicle. Tracks are on a grid over the times of
    `metadata.ts`, see `build_time_grid`.
    """
    description = _load_description(path)
    dataset = str(description["metadata"].get("dataset", ""))
    frames = _read_frame_count(path, description)
    grid = _read_times(path, description["metadata"], frames)
    tracks, track_notes = _build_tracks(path, description["tracks"], frames)
    check_frame_count(f"{path}: metadata.ts", len(grid.times), len(tracks))
    tracks = tuple(map(grid.resample, tracks))
    hd_map, map_notes = build_scenarionet_map(path, description, dataset)
    cavs, cav_notes = _find_cavs(description["metadata"], tracks)
    if dataset == "nuscenes" and cavs:
        tracks = tuple(_correct_nuscenes_ego(track) if track.id in cavs else track for track in tracks)
        cav_notes = (
            f"{cavs[0]}: box centre taken as {AXLE_TO_CENTRE_M} m ahead of the pose, a rear axle in nuScenes;"
            " the longer side of its box taken as the length, whichever the source calls so",
        )
    return Recording(
        id=str(description.get("id", path.stem)),
        source="scenarionet",
        dt_s=grid.dt_s,
        frame_count=len(grid.times),
        views=(ObserverView("log", tracks),),
        map=hd_map,
        cavs=cavs,
        notes=(*grid.describe(), *track_notes, *cav_notes, *map_notes),
    )


def _correct_nuscenes_ego(track: RecordedTrack) -> RecordedTrack:
    """Correct the recording car of nuScenes: its pose is the rear axle, and ScenarioNet swaps length and width."""
    length, width = np.fmax(track.length, track.width), np.fmin(track.length, track.width)
    return shift_ahead(track.replace_columns(length=length, width=width), AXLE_TO_CENTRE_M)


def _load_description(path: Path) -> Mapping[str, Any]:
    description = load_pickle(path)
    if not isinstance(description, dict):
        raise InputError(f"{path}: expected a scenario description (a dict), found {type(description).__name__}")
    for name in ("tracks", "map_features", "metadata"):
        if not isinstance(description.get(name), dict):
            raise InputError(
                f"{path}: {name}: expected a dict, found {type(description.get(name)).__name__}; is it of ScenarioNet?"
            )
    return description


def _read_frame_count(path: Path, description: Mapping[str, Any]) -> int:
    length = description.get("length")
    if not isinstance(length, int | np.integer) or length < 2:
        raise InputError(f"{path}: length: expected at least 2 frames, found {describe_value(length)}")
    return int(length)


def _read_times(path: Path, metadata: Mapping[str, Any], frames: int) -> TimeGrid:
    ts = parse_numbers(f"{path}: metadata.ts", metadata.get("ts", ())).ravel()
    if len(ts) != frames or not np.isfinite(ts).all() or not (np.diff(ts) > 0).all():
        raise InputError(f"{path}: metadata.ts: expected {frames} growing times, found {describe_value(ts)}")
    return build_time_grid(f"{path}: metadata.ts", ts)


def _build_tracks(path: Path, raw: Mapping[str, Any], frames: int) -> tuple[tuple[RecordedTrack, ...], tuple[str, ...]]:
    skipped: Counter[str] = Counter()
    tracks: list[RecordedTrack] = []
    for id_, raw_track in raw.items():
        where = f"{path}: tracks.{id_}"
        category = _classify(where, raw_track)
        if category is None:
            skipped[f"of the unknown type {raw_track['type']}"] += 1
            continue
        track = _build_track(where, str(id_), category, raw_track["state"], frames)
        if track.valid.any():
            tracks.append(track)
        else:
            skipped["without any valid frame"] += 1
    if not tracks:
        raise InputError(f"{path}: tracks: expected at least one with a valid frame, found none")
    return tuple(tracks), tuple(f"{count} tracks {why} skipped" for why, count in sorted(skipped.items()))


def _classify(where: str, track: Any) -> ObjectCategory | None:
    if not isinstance(track, dict) or "type" not in track or not isinstance(track.get("state"), dict):
        raise InputError(f"{where}: expected a dict with type and state, found {type(track).__name__}")
    metadata = track.get("metadata")
    finer = CATEGORY_BY_NUSCENES_TYPE.get(str(metadata.get("type"))) if isinstance(metadata, dict) else None
    coarse = CATEGORY_BY_TYPE.get(str(track["type"]))
    return finer or coarse


def _build_track(
    where: str, id_: str, category: ObjectCategory, state: Mapping[str, Any], frames: int
) -> RecordedTrack:
    position = _read_column(where, state, "position", frames)
    valid = _read_column(where, state, "valid", frames)[:, 0] > 0.5
    heading = _read_column(where, state, "heading", frames)[:, 0]
    length, width = (_read_size(where, state, name, frames) for name in ("length", "width"))
    bad = valid & ~np.isfinite(position[:, :2]).all(1)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"{where}: position: expected finite x and y in frame {first}, found {position[first].tolist()}"
        )
    there = np.where(valid, 1.0, np.nan)
    return RecordedTrack(
        id=id_,
        category=category,
        valid=valid,
        x=position[:, 0] * there,
        y=position[:, 1] * there,
        yaw=np.where(valid & np.isfinite(heading), heading, np.nan),
        length=np.where(valid & (length > 0), length, np.nan),
        width=np.where(valid & (width > 0), width, np.nan),
        parked=category is ObjectCategory.STATIC,
    )


def _read_size(where: str, state: Mapping[str, Any], name: str, frames: int) -> Float:
    """Return a column (T,) [m]; NaN where the source lacks it: MetaDrive records no sizes of some objects."""
    return _read_column(where, state, name, frames)[:, 0] if name in state else np.full(frames, np.nan)


def _read_column(where: str, state: Mapping[str, Any], name: str, frames: int) -> Float:
    """Return a column as (T, K): nuScenes has sizes as (T, 1), Waymo as (T,)."""
    if name not in state:
        raise InputError(f"{where}: expected state.{name}, found {', '.join(sorted(map(str, state))) or 'nothing'}")
    rows = parse_numbers(f"{where}: state.{name}", state[name])
    rows = rows[:, None] if rows.ndim == 1 else rows
    least = 2 if name == "position" else 1
    if rows.ndim != 2 or len(rows) != frames or rows.shape[1] < least:
        raise InputError(f"{where}: state.{name}: expected {frames} rows, found {describe_value(rows)}")
    return rows


def _find_cavs(
    metadata: Mapping[str, Any], tracks: tuple[RecordedTrack, ...]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    sdc = str(metadata.get("sdc_id", ""))
    if sdc in {track.id for track in tracks}:
        return (sdc,), ()
    return (), (f"the source names {sdc!r} as its own car, which is not among the tracks",)
