"""INTERACTION: read track tables (.csv) and a Lanelet2 map.

Source: Zhan et al., INTERACTION dataset, 2019, and its documentation of the columns: 10 Hz, metres, radians, full
sizes, x and y of the box centre; pedestrians and bicycles share a table without heading and size. Version 1.2 has one
table for all road users of many cases of 4 s each: `case_id`, and cells that are empty where a pedestrian has no value.
"""

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.readers.input_checks import check_frame_count
from real2sim.readers.lanelet2 import read_lanelet2
from real2sim.readers.tables import find_columns, open_table, read_header
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

DT_S = 0.1
STEP_MS = 100
"""[ms] The data set has 10 rows a second."""
CASE_COLUMN = "case_id"
KEY_COLUMNS = ("track_id", "timestamp_ms", "agent_type")
MOTION_COLUMNS = ("x", "y", "vx", "vy")
BOX_COLUMNS = ("psi_rad", "length", "width")
CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "car": ObjectCategory.CAR,
    "truck": ObjectCategory.TRUCK,
    "bus": ObjectCategory.BUS,
    "motorcycle": ObjectCategory.MOTORCYCLE,
    "bicycle": ObjectCategory.BICYCLE,
    "pedestrian": ObjectCategory.PEDESTRIAN,
    "pedestrian/bicycle": ObjectCategory.PEDESTRIAN,
}
SPLIT = re.compile(r"_(train|val|obs|test)$")
"""End of the name of a table of version 1.2."""
CYCLING_MPS = 3.0
"""Median speed above which a "pedestrian/bicycle" counts as a bicycle: few people run faster or ride slower."""


@dataclass(frozen=True)
class _TrackRow:
    line: int
    id: str
    agent_type: str
    time_ms: float
    values: tuple[float, ...]
    """Values of MOTION_COLUMNS, then BOX_COLUMNS; NaN for missing columns and empty cells."""


def read_interaction(tracks: Path, osm: Path, case: str = "") -> Recording:
    """Read `vehicle_tracks_*.csv` and the pedestrians next to it, or a folder with one such pair; raise InputError.

    `case` names one of a table with several cases (version 1.2).
    All tracks are in one view; none is a connected vehicle.
    """
    vehicles = _find_vehicle_file(tracks)
    pedestrians = vehicles.with_name(vehicles.name.replace("vehicle", "pedestrian"))
    if not case and len(cases := list_cases(vehicles)) > 1:
        raise InputError(f"{vehicles}: expected the name of one case, found {len(cases)} cases from {cases[0]} on")
    rows = {vehicles: _read_rows(vehicles, MOTION_COLUMNS + BOX_COLUMNS, case)}
    if pedestrians != vehicles and pedestrians.is_file():
        rows[pedestrians] = _read_rows(pedestrians, MOTION_COLUMNS)
    times = [row.time_ms for its_rows in rows.values() for row in its_rows]
    tracks_found = sum(len({row.id for row in its_rows}) for its_rows in rows.values())
    steps = (max(times) - min(times)) / STEP_MS
    frames = check_frame_count(f"{vehicles}: timestamp_ms", steps + 1.5, tracks_found)  # rounded to whole steps
    its_tracks = tuple(
        track for path, its_rows in rows.items() for track in _build_tracks(path, its_rows, min(times), frames)
    )
    hd_map, notes = read_lanelet2(osm)
    return Recording(
        id=_build_id(osm, vehicles, case),
        source="interaction",
        dt_s=DT_S,
        frame_count=frames,
        views=(ObserverView("log", its_tracks),),
        map=hd_map,
        notes=(*_note_guesses(its_tracks), *notes),
    )


def find_interaction_map(tracks: Path, maps: Sequence[Path] = ()) -> Path:
    """Return the one map given, else that beside the tracks, else that of the data set's `maps` folder.

    Raises InputError if there is none or more than one. The data set names a map after the folder of the tracks
    (version 1.0) or after their table (1.2: `DR_X_train.csv`).
    """
    folder = tracks if tracks.is_dir() else tracks.parent
    candidates = tuple(maps) or tuple(sorted(folder.glob("*.osm")))
    if not candidates:
        above = [place / "maps" for place in folder.resolve().parents[:2]]
        names = (folder.resolve().name, SPLIT.sub("", tracks.stem))
        candidates = tuple(path for place in above for name in names if (path := place / f"{name}.osm").is_file())
    if len(candidates) != 1:
        raise InputError(
            f"{folder}: expected one Lanelet2 map *.osm beside the tracks (or --map), found {len(candidates)}"
        )
    return candidates[0]


def _build_id(osm: Path, vehicles: Path, case: str) -> str:
    name = vehicles.stem if vehicles.stem.startswith(osm.stem) else f"{osm.stem}_{vehicles.stem}"
    return f"{name}_case{case}" if case else name


def _find_vehicle_file(tracks: Path) -> Path:
    if not tracks.is_dir():
        return tracks
    files = sorted(tracks.glob("vehicle_tracks_*.csv"))
    if len(files) != 1:
        raise InputError(f"{tracks}: expected one vehicle_tracks_*.csv (name one of several), found {len(files)}")
    return files[0]


def list_cases(path: Path) -> tuple[str, ...]:
    """Return the cases of a table in their order, () for a table without the column `case_id`; raise InputError."""
    with open_table(path) as table:
        header = read_header(table)
        if CASE_COLUMN not in header:
            return ()
        column = header.index(CASE_COLUMN)
        return tuple(dict.fromkeys(_name_case(cells[column]) for cells in table if len(cells) == len(header)))


def _name_case(text: str) -> str:
    """Return the name of a case; version 1.2 numbers them 1.0, 2.0, ..."""
    name = text.strip()
    return name.removesuffix(".0")


def _read_rows(path: Path, columns: Sequence[str], case: str = "") -> list[_TrackRow]:
    with open_table(path) as table:
        rows = list(_parse_rows(path, table, columns, case))
    if not rows:
        wanted = f" of the case {case}" if case else ""
        raise InputError(f"{path}: expected at least one row{wanted}, found none")
    return rows


def _parse_rows(path: Path, table: Iterator[list[str]], columns: Sequence[str], case: str) -> Iterator[_TrackRow]:
    """Yield the rows of a case, or all."""
    header = read_header(table)
    wanted = (*((CASE_COLUMN,) if case else ()), *KEY_COLUMNS, *columns)
    *case_columns, id_, time, agent_type = find_columns(path, header, wanted[: len(wanted) - len(columns)])
    values = find_columns(path, header, columns)
    rest = (math.nan,) * (len(MOTION_COLUMNS) + len(BOX_COLUMNS) - len(columns))
    for line, cells in enumerate(table, start=2):
        if not cells:
            continue
        if len(cells) != len(header):
            raise InputError(f"{path}: line {line}: expected {len(header)} columns, found {len(cells)}")
        if any(_name_case(cells[column]) != case for column in case_columns):
            continue
        numbers = tuple(_parse_number(path, line, header[index], cells[index]) for index in (time, *values))
        yield _TrackRow(line, cells[id_], cells[agent_type], numbers[0], numbers[1:] + rest)


def _parse_number(path: Path, line: int, name: str, text: str) -> float:
    """Return a number; NaN for an empty cell of heading or size, which version 1.2 leaves for pedestrians."""
    if name in BOX_COLUMNS and not text.strip():
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (name in ("length", "width") and value <= 0):
        what = "a positive number" if name in ("length", "width") else "a finite number"
        raise InputError(f"{path}: line {line}: {name}: expected {what}, found {text!r}")
    return value


def _build_tracks(path: Path, rows: Sequence[_TrackRow], start_ms: float, frames: int) -> Iterator[RecordedTrack]:
    by_id: defaultdict[str, list[_TrackRow]] = defaultdict(list)
    for row in rows:
        by_id[row.id].append(row)
    for id_, its_rows in by_id.items():
        index = _compute_frames(path, its_rows, start_ms)
        table = np.full((frames, len(MOTION_COLUMNS) + len(BOX_COLUMNS)), np.nan)
        table[index] = [row.values for row in its_rows]
        yield _build_track(id_, _classify(path, its_rows[0]), table)


def _compute_frames(path: Path, rows: Sequence[_TrackRow], start_ms: float) -> npt.NDArray[np.intp]:
    steps = (np.array([row.time_ms for row in rows]) - start_ms) / STEP_MS
    index = np.rint(steps).astype(np.intp)
    for row, step, frame in zip(rows, steps, index, strict=True):
        if abs(step - frame) > 0.01:
            raise InputError(
                f"{path}: line {row.line}: timestamp_ms: expected a multiple of {STEP_MS} after {start_ms:g}, "
                f"found {row.time_ms:g}"
            )
    _, first, count = np.unique(index, return_index=True, return_counts=True)
    if (count > 1).any():
        row = rows[first[count > 1][0]]
        raise InputError(f"{path}: track {row.id}: expected one row at {row.time_ms:g} ms, found {count.max()}")
    return index


def _classify(path: Path, row: _TrackRow) -> ObjectCategory:
    try:
        return CATEGORY_BY_TYPE[row.agent_type]
    except KeyError:
        types = ", ".join(CATEGORY_BY_TYPE)
        raise InputError(
            f"{path}: line {row.line}: agent_type: expected one of {types}, found {row.agent_type!r}"
        ) from None


def _build_track(id_: str, category: ObjectCategory, table: Float) -> RecordedTrack:
    x, y, vx, vy, yaw, length, width = table.T
    if category is ObjectCategory.PEDESTRIAN and np.nanmedian(np.hypot(vx, vy)) > CYCLING_MPS:
        category = ObjectCategory.BICYCLE
    return RecordedTrack(id_, category, np.isfinite(x), x, y, yaw, length, width)


def _note_guesses(tracks: Sequence[RecordedTrack]) -> tuple[str, ...]:
    cyclists = sum(track.category is ObjectCategory.BICYCLE for track in tracks)
    return (f"{cyclists} of the pedestrian/bicycle tracks taken for bicycles by their speed",) if cyclists else ()
