"""ScenarioNet: scenario descriptions (.pkl) of nuScenes, Waymo and nuPlan become recordings.

Source: Li et al., ScenarioNet, NeurIPS 2023, and its documentation of ScenarioDescription: `tracks[id].state` has
arrays with one row a frame, `map_features` what the map shows, `dynamic_map_states` the traffic lights; metres,
radians.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.readers.safe_pickle import load_pickle
from real2sim.readers.scenarionet_map import read_map
from real2sim.readers.shapes import brief, moved_ahead, numbers
from real2sim.recording import Category, Recording, Track, View

CATEGORIES: Mapping[str, Category] = {
    "VEHICLE": Category.CAR,
    "CYCLIST": Category.BICYCLE,
    "PEDESTRIAN": Category.PEDESTRIAN,
    "TRAFFIC_CONE": Category.STATIC,
    "TRAFFIC_BARRIER": Category.STATIC,
    "TRAFFIC_OBJECT": Category.STATIC,
}
FINER: Mapping[str, Category] = {
    "vehicle.truck": Category.TRUCK,
    "vehicle.construction": Category.TRUCK,
    "vehicle.trailer": Category.TRUCK,
    "vehicle.bus.rigid": Category.BUS,
    "vehicle.bus.bendy": Category.BUS,
    "vehicle.emergency.ambulance": Category.VAN,
    "vehicle.motorcycle": Category.MOTORCYCLE,
}
"""nuScenes tells more in the metadata of a track than in its type."""
AXLE_TO_CENTRE_M = 1.385
"""From the rear axle to the box centre of nuScenes' Renault Zoe: 4.084 m long with a rear overhang of 0.657 m.

Its pose is that of the rear axle (nutonomy/nuscenes-devkit issue 108), and the converter keeps it.
"""


def read_scenarionet(path: Path) -> Recording:
    """Reads one scenario description; raises InputError.

    The self-driving car (`sdc_id`) is the only connected vehicle. Frames are `dt_s` apart by the mean of `metadata.ts`.
    """
    description = _description(path)
    dataset = str(description["metadata"].get("dataset", ""))
    frames = _frames(path, description)
    dt_s, time_notes = _dt(path, description["metadata"], frames)
    tracks, track_notes = _tracks(path, description["tracks"], frames)
    hd_map, map_notes = read_map(path, description, dataset)
    cavs, cav_notes = _cavs(description["metadata"], tracks)
    if dataset == "nuscenes" and cavs:
        tracks = tuple(_own_car(track) if track.id in cavs else track for track in tracks)
        cav_notes = (
            f"{cavs[0]}: box centre taken as {AXLE_TO_CENTRE_M} m ahead of the pose, a rear axle in nuScenes;"
            " the longer side of its box taken as the length, whichever the source calls so",
        )
    return Recording(
        id=str(description.get("id", path.stem)),
        source="scenarionet",
        dt_s=dt_s,
        frames=frames,
        views=(View("log", tracks),),
        map=hd_map,
        cavs=cavs,
        notes=(*time_notes, *track_notes, *cav_notes, *map_notes),
    )


def _own_car(track: Track) -> Track:
    """The recording car of nuScenes: its pose is its rear axle, and ScenarioNet swaps length and width of its box."""
    length, width = np.fmax(track.length, track.width), np.fmin(track.length, track.width)
    return moved_ahead(track.with_rows(length=length, width=width), AXLE_TO_CENTRE_M)


def _description(path: Path) -> Mapping[str, Any]:
    description = load_pickle(path)
    if not isinstance(description, dict):
        raise InputError(f"{path}: expected a scenario description (a dict), found {type(description).__name__}")
    for name in ("tracks", "map_features", "metadata"):
        if not isinstance(description.get(name), dict):
            raise InputError(
                f"{path}: {name}: expected a dict, found {type(description.get(name)).__name__}; is it of ScenarioNet?"
            )
    return description


def _frames(path: Path, description: Mapping[str, Any]) -> int:
    length = description.get("length")
    if not isinstance(length, int | np.integer) or length < 2:
        raise InputError(f"{path}: length: expected at least 2 frames, found {brief(length)}")
    return int(length)


def _dt(path: Path, metadata: Mapping[str, Any], frames: int) -> tuple[float, tuple[str, ...]]:
    ts = numbers(f"{path}: metadata.ts", metadata.get("ts", ())).ravel()
    steps = np.diff(ts)
    if len(ts) != frames or not np.isfinite(ts).all() or not (steps > 0).all():
        raise InputError(f"{path}: metadata.ts: expected {frames} growing times, found {brief(ts)}")
    dt_s = round(float(steps.mean()), 3)
    off = float(np.abs(steps - dt_s).max())
    uneven = f"frames are taken as {dt_s:g} s apart; the clock of the source is off by up to {off:.3f} s"
    return dt_s, (uneven,) if off > 0.1 * dt_s else ()


def _tracks(path: Path, raw: Mapping[str, Any], frames: int) -> tuple[tuple[Track, ...], tuple[str, ...]]:
    passed_over: Counter[str] = Counter()
    tracks: list[Track] = []
    for id_, one in raw.items():
        where = f"{path}: tracks.{id_}"
        category = _category(where, one)
        if category is None:
            passed_over[f"of the unknown type {one['type']}"] += 1
            continue
        track = _track(where, str(id_), category, one["state"], frames)
        if track.valid.any():
            tracks.append(track)
        else:
            passed_over["without any valid frame"] += 1
    if not tracks:
        raise InputError(f"{path}: tracks: expected at least one with a valid frame, found none")
    return tuple(tracks), tuple(f"{count} tracks {why} passed over" for why, count in sorted(passed_over.items()))


def _category(where: str, one: Any) -> Category | None:
    if not isinstance(one, dict) or "type" not in one or not isinstance(one.get("state"), dict):
        raise InputError(f"{where}: expected a dict with type and state, found {type(one).__name__}")
    metadata = one.get("metadata")
    finer = FINER.get(str(metadata.get("type"))) if isinstance(metadata, dict) else None
    coarse = CATEGORIES.get(str(one["type"]))
    return finer or coarse


def _track(where: str, id_: str, category: Category, state: Mapping[str, Any], frames: int) -> Track:
    position = _column(where, state, "position", frames)
    valid = _column(where, state, "valid", frames)[:, 0] > 0.5
    heading, length, width = (_column(where, state, name, frames)[:, 0] for name in ("heading", "length", "width"))
    bad = valid & ~np.isfinite(position[:, :2]).all(1)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"{where}: position: expected finite x and y in frame {first}, found {position[first].tolist()}"
        )
    there = np.where(valid, 1.0, np.nan)
    return Track(
        id=id_,
        category=category,
        valid=valid,
        x=position[:, 0] * there,
        y=position[:, 1] * there,
        yaw=np.where(valid & np.isfinite(heading), heading, np.nan),
        length=np.where(valid & (length > 0), length, np.nan),
        width=np.where(valid & (width > 0), width, np.nan),
        parked=category is Category.STATIC,
    )


def _column(where: str, state: Mapping[str, Any], name: str, frames: int) -> Float:
    """(T, K): nuScenes has sizes as (T, 1), Waymo as (T,)."""
    if name not in state:
        raise InputError(f"{where}: expected state.{name}, found {', '.join(sorted(map(str, state))) or 'nothing'}")
    rows = numbers(f"{where}: state.{name}", state[name])
    rows = rows[:, None] if rows.ndim == 1 else rows
    least = 2 if name == "position" else 1
    if rows.ndim != 2 or len(rows) != frames or rows.shape[1] < least:
        raise InputError(f"{where}: state.{name}: expected {frames} rows, found {brief(rows)}")
    return rows


def _cavs(metadata: Mapping[str, Any], tracks: tuple[Track, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    sdc = str(metadata.get("sdc_id", ""))
    if sdc in {track.id for track in tracks}:
        return (sdc,), ()
    return (), (f"the source names {sdc!r} as its own car, which is not among the tracks",)
