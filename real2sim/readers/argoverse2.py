"""Argoverse 2: select the reader of a folder by its files, and read a motion-forecasting scenario (tracks and a map).

Source: Wilson et al., Argoverse 2, NeurIPS Datasets 2021. City frame [m], headings [rad], 10 Hz; no sizes.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool
from real2sim.readers.argoverse2_map import find_single_file, read_argoverse2_map
from real2sim.readers.argoverse2_sensor import read_argoverse2_sensor
from real2sim.readers.tables import Columns, read_columns
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "vehicle": ObjectCategory.CAR,
    "bus": ObjectCategory.BUS,
    "motorcyclist": ObjectCategory.MOTORCYCLE,
    "cyclist": ObjectCategory.BICYCLE,
    "pedestrian": ObjectCategory.PEDESTRIAN,
    "static": ObjectCategory.STATIC,
    "construction": ObjectCategory.STATIC,
    "riderless_bicycle": ObjectCategory.STATIC,
}
"""`background` and `unknown` are omitted because their class is not defined."""
EGO_ID = "AV"
DT_S = 0.1
"""[s] The table numbers time steps, which are 10 a second."""
MAX_FRAMES = 10_000
"""A thousand seconds: larger values are damaged."""
NUMBER_COLUMNS = ("timestep", "position_x", "position_y", "heading")


def read_argoverse2(folder: Path) -> Recording:
    """Read a folder of either part of Argoverse 2; raise InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of Argoverse 2, found {'a file' if folder.exists() else 'none'}")
    if any(folder.glob("*.parquet")):
        return read_argoverse2_forecasting(folder)
    if any(folder.glob("*.feather")):
        return read_argoverse2_sensor(folder)
    raise InputError(f"{folder}: expected scenario_*.parquet or annotations.feather of Argoverse 2, found neither")


def read_argoverse2_forecasting(folder: Path) -> Recording:
    """Read the `scenario_*.parquet` and `log_map_archive_*.json` of a folder; raise InputError.

    The recording car (track "AV") is the connected vehicle. Sizes are NaN: the source has none. The source does not
    define the reference point of the AV; all positions are taken as box centres.
    """
    path = find_single_file(folder, "scenario_*.parquet")
    rows = read_columns(path, NUMBER_COLUMNS, ("track_id", "object_type", "scenario_id"))
    frames = _count_frames(path, rows)
    tracks, notes = _build_tracks(path, rows, frames)
    hd_map, map_notes = read_argoverse2_map(folder)
    cavs = tuple(track.id for track in tracks if track.id == EGO_ID)
    return Recording(
        id=str(rows["scenario_id"][0]),
        source="argoverse2",
        dt_s=DT_S,
        frame_count=frames,
        views=(ObserverView("log", tracks),),
        map=hd_map,
        cavs=cavs,
        notes=(*notes, *map_notes) if cavs else (*notes, *map_notes, f"no track {EGO_ID}: no connected vehicle"),
    )


def _count_frames(path: Path, rows: Columns) -> int:
    low, high = int(rows["timestep"].min()), int(rows["timestep"].max())
    if low < 0 or not 1 <= high < MAX_FRAMES:
        raise InputError(f"{path}: timestep: expected frames 0 to at most {MAX_FRAMES - 1}, found {low} to {high}")
    return high + 1


def _build_tracks(path: Path, rows: Columns, frames: int) -> tuple[tuple[RecordedTrack, ...], tuple[str, ...]]:
    skipped: Counter[str] = Counter()
    tracks: list[RecordedTrack] = []
    for id_ in dict.fromkeys(rows["track_id"].tolist()):
        chosen = rows["track_id"] == id_
        word = str(rows["object_type"][chosen][0])
        category = CATEGORY_BY_TYPE.get(word)
        if category is None:
            skipped[word] += 1
        else:
            tracks.append(_build_track(path, rows, chosen, category, frames))
    if not tracks:
        raise InputError(f"{path}: object_type: expected at least one known type, found {', '.join(skipped)}")
    return tuple(tracks), tuple(f"{count} tracks of type {word} skipped" for word, count in skipped.items())


def _build_track(path: Path, rows: Columns, chosen: Bool, category: ObjectCategory, frames: int) -> RecordedTrack:
    id_, timesteps = str(rows["track_id"][chosen][0]), rows["timestep"][chosen].astype(np.intp)
    if len(np.unique(timesteps)) < len(timesteps):
        raise InputError(
            f"{path}: track {id_}: expected one row a timestep, found {len(timesteps)} for {len(np.unique(timesteps))}"
        )
    x, y, yaw, size = np.full((4, frames), np.nan)
    for column, name in ((x, "position_x"), (y, "position_y"), (yaw, "heading")):
        column[timesteps] = rows[name][chosen]
    return RecordedTrack(
        id=id_,
        category=category,
        valid=np.isfinite(x),
        x=x,
        y=y,
        yaw=yaw,
        length=size,
        width=size,
        parked=category is ObjectCategory.STATIC,
    )
