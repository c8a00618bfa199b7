"""Vector map of an Argoverse 2 log: lane segments and pedestrian crossings in the city frame [m]."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, Field

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.scenario import load_model
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.input_checks import parse_points
from real2sim.readers.map_geometry import build_separate_areas, compute_centreline

LANE_KIND_BY_TYPE: Mapping[str, LaneKind] = {
    "VEHICLE": LaneKind.DRIVING,
    "BUS": LaneKind.DRIVING,
    "BIKE": LaneKind.BIKE,
}


class Av2Point(BaseModel, frozen=True):
    """A point in the city frame [m] without its height."""

    x: float = Field(allow_inf_nan=False)
    y: float = Field(allow_inf_nan=False)


def _to_id(raw: Any) -> Any:
    return str(raw) if isinstance(raw, int) else raw


Av2Line = tuple[Av2Point, ...]
Av2Id = Annotated[str, BeforeValidator(_to_id)]


class Av2LaneSegment(BaseModel, frozen=True):
    """A lane segment. The forecasting part has centre lines, the sensor part has none."""

    lane_type: str
    is_intersection: bool
    centerline: Av2Line = ()
    left_lane_boundary: Av2Line
    right_lane_boundary: Av2Line
    predecessors: tuple[Av2Id, ...]
    successors: tuple[Av2Id, ...]
    left_neighbor_id: Av2Id | None
    right_neighbor_id: Av2Id | None


class Av2Crossing(BaseModel, frozen=True):
    """The two long edges of a pedestrian crossing."""

    edge1: Av2Line = Field(min_length=2)
    edge2: Av2Line = Field(min_length=2)


class Av2DrivableArea(BaseModel, frozen=True):
    """The outline of a drivable area."""

    area_boundary: Av2Line = Field(min_length=3)


class Av2MapArchive(BaseModel, frozen=True):
    """The fields of a `log_map_archive_*.json` that are used."""

    lane_segments: dict[str, Av2LaneSegment] = Field(min_length=1)
    pedestrian_crossings: dict[str, Av2Crossing] = {}
    drivable_areas: dict[str, Av2DrivableArea] = {}


def read_argoverse2_map(folder: Path) -> tuple[HdMap, tuple[str, ...]]:
    """Read the `log_map_archive_*.json` in a folder; return notes on skipped elements; raise InputError."""
    path = find_single_file(folder, "log_map_archive_*.json")
    archive = load_model(path, Av2MapArchive)
    read = ((id_, _build_lane(path, id_, segment)) for id_, segment in archive.lane_segments.items())
    lanes = {id_: lane for id_, lane in read if lane is not None}
    lost = len(archive.lane_segments) - len(lanes)
    if not lanes:
        raise InputError(f"{path}: lane_segments: expected at least one that is a lane, found none in {lost}")
    crossings = tuple(_build_crosswalk(path, id_, crossing) for id_, crossing in archive.pedestrian_crossings.items())
    outlines = (
        _to_xy(f"{path}: drivable_areas.{id_}", area.area_boundary) for id_, area in archive.drivable_areas.items()
    )
    hd_map = HdMap(
        lanes=_drop_oncoming_neighbours(lanes), crosswalks=crossings, drivable_areas=build_separate_areas(outlines)
    )
    return hd_map, (f"{lost} lane segments of an unknown type or without length skipped",) if lost else ()


def find_single_file(folder: Path, *patterns: str) -> Path:
    """Return the only file that matches the first pattern with any match; raise InputError."""
    for pattern in patterns:
        files = sorted(folder.glob(pattern))
        if len(files) == 1:
            return files[0]
        if files:
            names = f"{files[0].name}, {files[1].name}"
            raise InputError(f"{folder}: expected one {pattern}, found {len(files)}, such as {names}")
    raise InputError(f"{folder}: expected {' or '.join(patterns)}, found none")


def _build_lane(path: Path, id_: str, segment: Av2LaneSegment) -> MapLane | None:
    where = f"{path}: lane_segments.{id_}"
    kind = LANE_KIND_BY_TYPE.get(segment.lane_type)
    centre, left, right = (
        _to_xy(where, line) for line in (segment.centerline, segment.left_lane_boundary, segment.right_lane_boundary)
    )
    if kind is None or min(len(left), len(right)) < 2:
        return None
    return MapLane(
        id=id_,
        kind=kind,
        centre=centre if len(centre) > 1 else compute_centreline(left, right),
        left=left,
        right=right,
        entries=segment.predecessors,
        exits=segment.successors,
        left_neighbour=segment.left_neighbor_id or "",
        right_neighbour=segment.right_neighbor_id or "",
        junction=segment.is_intersection,
    )


def _to_xy(where: str, line: Av2Line) -> Float:
    return parse_points(where, [(point.x, point.y) for point in line]) if line else np.zeros((0, 2))


def _build_crosswalk(path: Path, id_: str, crossing: Av2Crossing) -> Float:
    """Join the two long edges to a ring (N, 2)."""
    first, second = (_to_xy(f"{path}: pedestrian_crossings.{id_}", edge) for edge in (crossing.edge1, crossing.edge2))
    same_way = (first[-1] - first[0]) @ (second[-1] - second[0]) > 0
    return np.concatenate((first, second[::-1] if same_way else second))


def _drop_oncoming_neighbours(lanes: Mapping[str, MapLane]) -> dict[str, MapLane]:
    """Remove neighbours with the opposite direction, which the source lists as well."""

    def kept(lane: MapLane, other: str) -> str:
        return other if other in lanes and _compute_chord(lane) @ _compute_chord(lanes[other]) > 0 else ""

    return {
        id_: replace(
            lane,
            left_neighbour=kept(lane, lane.left_neighbour),
            right_neighbour=kept(lane, lane.right_neighbour),
        )
        for id_, lane in lanes.items()
    }


def _compute_chord(lane: MapLane) -> Float:
    return lane.centre[-1] - lane.centre[0]
