"""Read from an OpenDRIVE map what netconvert loses: stop signs and the exact position of roads."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.roads import Lane, RoadMap, StopSignBox
from real2sim.xml_file import Element, read_number, read_xml

STOP_SIGN = "206"
"""Type of a stop sign in CARLA's towns: number 206 of the German catalogue (StVO)."""
STOP_BOX_M = 4.0
"""[m] Length of a stop box, which OpenDRIVE does not define: it contains a car waiting up to 1.5 m before the line."""
APPROACH_M = 12.0
MAX_ROADS_M = 1e6
"""[m] CARLA's largest town has 11 km of reference lines."""
APPROACH_RAD = math.radians(45)


@dataclass(frozen=True, slots=True)
class OpenDriveSign:
    """A sign beside the road, in OpenDRIVE coordinates [m]; `yaw` [rad] is the direction of its traffic."""

    id: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True, slots=True)
class OpenDriveMap:
    """Date and stop signs of an OpenDRIVE map, and points (N, 2) [m] where a driving lane begins."""

    date: str
    stop_signs: tuple[OpenDriveSign, ...] | None
    """None if the file has no signals at all: it predates them, and its signs are unknown."""
    road_middles: Float


def read_opendrive(path: Path) -> OpenDriveMap:
    """Read an `.xodr` file; raise InputError."""
    root = read_xml(path)
    if root.tag != "OpenDRIVE":
        raise InputError(f"{path}: expected the root element <OpenDRIVE>, found <{root.tag}>")
    _check_length(path, root)
    roads = [road for road in root.iter("road") if road.get("junction") == "-1"]
    signs = [
        _read_sign(path, road, signal)
        for road in roads
        for signal in road.iter("signal")
        if signal.get("type") == STOP_SIGN
    ]
    header = root.find("header")
    return OpenDriveMap(
        date="" if header is None else header.get("date", ""),
        stop_signs=tuple(signs) if next(root.iter("signal"), None) is not None else None,
        road_middles=np.array([middle for road in roads for middle in _find_road_middle(path, road)]).reshape(-1, 2),
    )


def _check_length(path: Path, root: Element) -> None:
    """Raise InputError for roads that take more memory than there is, at a point for every metre."""
    pieces = (read_number(path, piece, "length") for piece in root.iter("geometry"))
    if not (total := sum(map(abs, pieces))) <= MAX_ROADS_M:
        raise InputError(f"{path}: expected roads of at most {MAX_ROADS_M:g} m in all, found {total:g} m")


def _read_sign(path: Path, road: Element, signal: Element) -> OpenDriveSign:
    """Read a sign. In right-hand traffic a sign at t < 0, right of the reference line, applies along that line.

    CARLA's towns use the opposite `orientation`; the lanes of their signalReferences confirm this reading.
    """
    t = read_number(path, signal, "t")
    x, y, yaw = _compute_pose(path, road, read_number(path, signal, "s"))
    driving = yaw if t < 0 else wrap_angle(yaw + math.pi)
    return OpenDriveSign(signal.get("id", ""), x - t * math.sin(yaw), y + t * math.cos(yaw), driving)


def _compute_pose(path: Path, road: Element, s: float) -> tuple[float, float, float]:
    """Return the pose on a road's reference line, which may consist of lines and arcs (as in all CARLA towns)."""
    pieces = sorted(road.iterfind("planView/geometry"), key=lambda piece: read_number(path, piece, "s"))
    begun = [piece for piece in pieces if read_number(path, piece, "s") <= s]
    if not begun:
        raise InputError(f"{path}: road {road.get('id')}: expected geometry at s = {s:g} m, found none")
    piece = begun[-1]
    x, y, yaw, at = (read_number(path, piece, name) for name in ("x", "y", "hdg", "s"))
    arc = piece.find("arc")
    if arc is None and piece.find("line") is None:
        raise InputError(
            f"{path}: road {road.get('id')}: expected a line or an arc, found {[part.tag for part in piece]}"
        )
    if max(map(abs, (x, y, yaw, at, s))) > MAX_ROADS_M:
        raise InputError(f"{path}: road {road.get('id')}: expected numbers within {MAX_ROADS_M:g}, found a larger one")
    turned = (s - at) * (0.0 if arc is None else read_number(path, arc, "curvature"))
    if not math.isfinite(turned):
        raise InputError(f"{path}: road {road.get('id')}: expected an arc with a finite curvature, found a larger one")
    chord = (s - at) * float(np.sinc(turned / 2 / math.pi))
    return (
        x + chord * math.cos(yaw + turned / 2),
        y + chord * math.sin(yaw + turned / 2),
        wrap_angle(yaw + turned),
    )


def _find_road_middle(path: Path, road: Element) -> list[tuple[float, float]]:
    """Return the middle of a road's zero line if a driving lane begins there and the line is simple to compute."""
    offsets = [[read_number(path, part, name) for name in "abcd"] for part in road.iterfind("lanes/laneOffset")]
    sections = list(road.iterfind("lanes/laneSection"))
    shapes = {shape.tag for piece in road.iterfind("planView/geometry") for shape in piece}
    if len(sections) != 1 or len(offsets) > 1 or any(map(any, (o[1:] for o in offsets))) or shapes - {"line", "arc"}:
        return []
    types = {lane.get("id"): lane.get("type") for lane in sections[0].iter("lane")}
    if "driving" not in (types.get("-1"), types.get("1")):
        return []
    x, y, yaw = _compute_pose(path, road, read_number(path, road, "length") / 2)
    t = offsets[0][0] if offsets else 0.0
    return [(x - t * math.sin(yaw), y + t * math.cos(yaw))]


def measure_offset_error(middles: Float, roads: RoadMap, offset: tuple[float, float]) -> float:
    """Return the median gap [m] between road middles and the lane border expected there, a round trip of the offset.

    NaN if the map has no suitable road (`_find_road_middle`).
    """
    if not len(middles):
        return math.nan
    near = roads.find_nearest_lanes(middles + np.array(offset))
    return float(np.median(np.abs(near.distance - roads.lane_width[near.lane] / 2)))


@dataclass(frozen=True, slots=True)
class PlacedSigns:
    """Stop boxes on lanes, and the ids of signs without a lane."""

    boxes: tuple[StopSignBox, ...]
    unplaced: tuple[str, ...]


def place_stop_signs(signs: Sequence[OpenDriveSign], roads: RoadMap, offset: tuple[float, float]) -> PlacedSigns:
    """Place one box on every lane of the road next to a sign; its line is level with the sign."""
    boxes: list[StopSignBox] = []
    unplaced: list[str] = []
    for sign in signs:
        x, y = sign.x + offset[0], sign.y + offset[1]
        approach = [lane for lane in roads.find_lanes_near(x, y, APPROACH_M) if _leads_to_sign(sign, lane, x, y)]
        if not approach:
            unplaced.append(sign.id)
            continue
        nearest = min(approach, key=lambda lane: abs(lane.centre.project(x, y)[1]))
        siblings = [lane for lane in approach if lane.edge == nearest.edge]
        for k, lane in enumerate(siblings):
            line_pos_m = round(lane.centre.project(x, y)[0], 3)
            name = sign.id if len(siblings) == 1 else f"{sign.id}.{k}"
            boxes.append(StopSignBox(id=name, lane=lane.id, line_pos_m=line_pos_m, length_m=STOP_BOX_M))
    return PlacedSigns(tuple(boxes), tuple(unplaced))


def _leads_to_sign(sign: OpenDriveSign, lane: Lane, x: float, y: float) -> bool:
    """Return whether a lane leads along the sign, to the left of it."""
    s, d = lane.centre.project(x, y)
    return not lane.junction and d < 0 and abs(wrap_angle(lane.centre.yaw_at(s) - sign.yaw)) < APPROACH_RAD
