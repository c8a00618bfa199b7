"""V2X-Seq (DAIR-V2X): read trajectories (`SCENE.csv`) and the vector map of their crossing (`*hdmap*.json`).

Source: Yu et al., V2X-Seq, CVPR 2023, and the description of its trajectory forecasting dataset: 10 Hz, metres and
radians in UTM, full sizes; the vehicle with the tag AV has recorded the scene. Points of the map are texts, "(x, y)".
"""

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, Field

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.scenario import load_model
from real2sim.hd_map import HdMap, LaneKind, MapLane, StopLine
from real2sim.readers.input_checks import check_frame_count, parse_points
from real2sim.readers.map_fit import check_place, measure_view_fit
from real2sim.readers.tables import TableRow, read_rows
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

DT_S = 0.1
"""[s] The data set has 10 rows a second."""
CLOCK_ERROR_S = 0.03
"""[s] A time further from the grid of frames is refused."""
KEYS = ("timestamp", "id", "type", "sub_type", "tag")
VALUES = ("x", "y", "theta", "length", "width")
CAV_TAG = "AV"
CATEGORY_BY_TYPE: Mapping[str, ObjectCategory] = {
    "car": ObjectCategory.CAR,
    "van": ObjectCategory.VAN,
    "truck": ObjectCategory.TRUCK,
    "bus": ObjectCategory.BUS,
    "motorcyclist": ObjectCategory.MOTORCYCLE,
    "tricyclist": ObjectCategory.MOTORCYCLE,
    "cyclist": ObjectCategory.BICYCLE,
    "pedestrian": ObjectCategory.PEDESTRIAN,
    "vehicle": ObjectCategory.CAR,
    "bicycle": ObjectCategory.BICYCLE,
}
"""Sub-types, else types, without case."""
KIND_BY_LANE_TYPE: Mapping[str, LaneKind] = {"BIKING": LaneKind.BIKE, "EMERGENCY_LANE": LaneKind.SHOULDER}
"""All other types of lanes are for cars."""
POINT = re.compile(r"\(\s*([^\s,()]+)\s*,\s*([^\s,()]+)\s*\)")


def _parse_point(raw: Any) -> Any:
    """Return a point as two numbers if it is a text."""
    match = POINT.fullmatch(raw) if isinstance(raw, str) else None
    return [float(match[1]), float(match[2])] if match else raw


Point = Annotated[tuple[float, float], BeforeValidator(_parse_point)]


def _drop_none(raw: Any) -> Any:
    """Return ids as texts without those that say none."""
    ids = raw if isinstance(raw, list) else [] if raw is None else [raw]
    return [str(id_) for id_ in ids if id_ is not None and str(id_) not in ("None", "")]


Ids = Annotated[tuple[str, ...], BeforeValidator(_drop_none)]


class _Lane(BaseModel):
    centerline: list[Point] = Field(min_length=2)
    lane_type: str = ""
    turn_direction: str = ""
    is_intersection: bool = False
    l_neighbor_id: Ids = ()
    r_neighbor_id: Ids = ()
    predecessors: Ids = ()
    successors: Ids = ()


class _Line(BaseModel):
    centerline: list[Point] = Field(min_length=2)


class _Crosswalk(BaseModel):
    polygon: list[Point] = Field(min_length=3)


class _MapFile(BaseModel):
    """The parts of a map that are used."""

    LANE: dict[str, _Lane] = Field(min_length=1)
    STOPLINE: dict[str, _Line] = {}
    CROSSWALK: dict[str, _Crosswalk] = {}


def read_v2xseq(path: Path, maps: Sequence[Path]) -> Recording:
    """Read a scene, and the map of the given ones (one or more) on which it lies; raise InputError.

    All tracks are in one view; the vehicle with the tag AV is the connected vehicle.
    """
    if not maps:
        raise InputError(f"{path}: expected the map of its crossing, found none")
    rows = list(read_rows(path, (*KEYS, *VALUES)))
    if not rows:
        raise InputError(f"{path}: expected at least one row, found none")
    times = np.array([row.parse_number(0, "timestamp") for row in rows])
    ids = dict.fromkeys(row.cells[1] for row in rows)
    frames = check_frame_count(f"{path}: timestamp", (times.max() - times.min()) / DT_S + 1.5, len(ids))
    tracks = _build_tracks(rows, times - times.min(), frames)
    views = (ObserverView("log", tracks),)
    candidates = {map_path: read_v2xseq_map(map_path) for map_path in maps}
    fits = {map_path: measure_view_fit(views, hd_map) for map_path, hd_map in candidates.items()}
    chosen = min(fits, key=lambda map_path: fits[map_path].median_m)
    check_place(str(path), fits[chosen])
    return Recording(
        id=path.stem,
        source="v2xseq",
        dt_s=DT_S,
        frame_count=frames,
        views=views,
        map=candidates[chosen],
        cavs=tuple(dict.fromkeys(row.cells[1] for row in rows if row.cells[4].strip() == CAV_TAG)),
        notes=(f"map: {chosen.name}",),
    )


def _build_tracks(rows: Sequence[TableRow], times: Float, frames: int) -> tuple[RecordedTrack, ...]:
    tables: defaultdict[str, Float] = defaultdict(lambda: np.full((frames, len(VALUES)), np.nan))
    types: defaultdict[str, Counter[ObjectCategory]] = defaultdict(Counter)
    for row, time in zip(rows, times.tolist(), strict=True):
        frame = round(time / DT_S)
        if abs(time - frame * DT_S) > CLOCK_ERROR_S:
            raise InputError(
                f"{row.where}: timestamp: expected steps of {DT_S:g} s, found {time:.3f} s after the first"
            )
        if np.isfinite(tables[row.cells[1]][frame, 0]):
            raise InputError(f"{row.where}: expected one row of object {row.cells[1]} at a time, found two")
        tables[row.cells[1]][frame] = [row.parse_number(5 + k, name) for k, name in enumerate(VALUES)]
        types[row.cells[1]][_classify(row)] += 1
    return tuple(RecordedTrack.from_table(id_, types[id_].most_common(1)[0][0], table) for id_, table in tables.items())


def _classify(row: TableRow) -> ObjectCategory:
    names = [text.strip().lower() for text in (row.cells[3], row.cells[2])]
    category = next((CATEGORY_BY_TYPE[name] for name in names if name in CATEGORY_BY_TYPE), None)
    if category is None:
        types = ", ".join(CATEGORY_BY_TYPE)
        raise InputError(f"{row.where}: sub_type: expected one of {types}, found {row.cells[3]!r}")
    return category


def read_v2xseq_map(path: Path) -> HdMap:
    """Read a map; raise InputError."""
    file = load_model(path, _MapFile)
    lanes = {id_: _build_lane(path, id_, lane) for id_, lane in file.LANE.items()}
    return HdMap(
        lanes=lanes,
        crosswalks=tuple(
            parse_points(f"{path}: CROSSWALK {id_}", crosswalk.polygon) for id_, crosswalk in file.CROSSWALK.items()
        ),
        stop_lines=tuple(
            StopLine(parse_points(f"{path}: STOPLINE {id_}", stop_line.centerline)[[0, -1]])
            for id_, stop_line in file.STOPLINE.items()
        ),
    )


def _build_lane(path: Path, id_: str, lane: _Lane) -> MapLane:
    centre = parse_points(f"{path}: LANE {id_}", lane.centerline)
    if len(centre) < 2:
        raise InputError(f"{path}: LANE {id_}: expected at least two distinct points, found {len(centre)}")
    return MapLane(
        id=id_,
        kind=KIND_BY_LANE_TYPE.get(lane.lane_type.upper(), LaneKind.DRIVING),
        centre=centre,
        entries=lane.predecessors,
        exits=lane.successors,
        left_neighbour=next(iter(lane.l_neighbor_id), ""),
        right_neighbour=next(iter(lane.r_neighbor_id), ""),
        junction=lane.is_intersection,
    )
