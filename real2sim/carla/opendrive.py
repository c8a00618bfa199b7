"""Read OpenDRIVE maps: repaired for netconvert, with what it loses, stop signs and the exact position of lanes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.roads import Lane, RoadMap, StopSignBox
from real2sim.carla.left_hand_map import is_left_hand_map, mirror_map
from real2sim.carla.map_repairs import repair_map
from real2sim.carla.reference_line import check_geometry, compute_pose
from real2sim.xml_file import Element, read_number, read_xml, strip_namespaces

STOP_SIGN = "206"
"""Type of a stop sign in CARLA's towns: number 206 of the German catalogue (StVO)."""
STOP_BOX_M = 4.0
"""[m] Length of a stop box, which OpenDRIVE does not define: it contains a car waiting up to 1.5 m before the line."""
APPROACH_M = 12.0
"""[m] Lanes this near to a sign are searched for the one that it stops; chosen: three lanes and a verge."""
MAX_ROADS_M = 1e6
"""[m] CARLA's largest town has 11 km of reference lines."""
MIN_ROAD_M = 5.0
"""[m] The middle of a shorter road may lie in the area that netconvert gives a junction."""
DISPLACED_M = 0.5
"""[m] A lane that is further off is not just rounded."""
MIN_WIDTH_M = 1.8
"""[m] netconvert leaves out narrower lanes (--opendrive.min-width)."""
APPROACH_RAD = math.radians(45)
"""The sign faces the lane that it stops; chosen half-way to the direction of a crossing road."""


@dataclass(frozen=True, slots=True)
class OpenDriveSign:
    """A sign beside the road, in OpenDRIVE coordinates [m]; `yaw` [rad] is the direction of its traffic."""

    id: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True, slots=True)
class OpenDriveMap:
    """An OpenDRIVE map as netconvert takes it. A left-hand map is mirrored at the x axis, with all that is read."""

    root: Element
    date: str
    is_changed: bool
    """Whether `root` differs from the file."""
    left_hand: bool
    repairs: tuple[str, ...]
    """What was changed besides mirroring."""
    stop_signs: tuple[OpenDriveSign, ...] | None
    """None if the file has no signals at all: it predates them, and its signs are unknown."""
    lane_middles: Float
    """Points (N, 2) [m] on the centre lines of driving lanes, half-way along their roads."""


def read_opendrive(path: Path) -> OpenDriveMap:
    """Read an `.xodr` file; raise InputError."""
    root = read_xml(path)
    has_namespace = strip_namespaces(root)
    if root.tag != "OpenDRIVE":
        raise InputError(f"{path}: expected the root element <OpenDRIVE>, found <{root.tag}>")
    _check_length(path, root)
    for road in root.iter("road"):
        check_geometry(path, road)
    left_hand = is_left_hand_map(path, root)
    if left_hand:
        mirror_map(path, root)
    repairs = repair_map(path, root)
    roads = [road for road in root.iter("road") if road.get("junction") == "-1"]
    signs = [
        _read_sign(path, road, signal)
        for road in roads
        for signal in road.iter("signal")
        if signal.get("type") == STOP_SIGN
    ]
    header = root.find("header")
    return OpenDriveMap(
        root=root,
        date="" if header is None else header.get("date", ""),
        is_changed=has_namespace or left_hand or bool(repairs),
        left_hand=left_hand,
        repairs=repairs,
        stop_signs=tuple(signs) if next(root.iter("signal"), None) is not None else None,
        lane_middles=np.array([middle for road in roads for middle in _find_lane_middles(path, road)]).reshape(-1, 2),
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
    x, y, yaw = compute_pose(path, road, read_number(path, signal, "s"))
    driving = yaw if t < 0 else wrap_angle(yaw + math.pi)
    return OpenDriveSign(signal.get("id", ""), x - t * math.sin(yaw), y + t * math.cos(yaw), driving)


def _find_lane_middles(path: Path, road: Element) -> Iterator[tuple[float, float]]:
    """Yield the middles of the innermost driving lanes of a road whose cross-section is simple to compute."""
    offsets = [[read_number(path, part, name) for name in "abcd"] for part in road.iterfind("lanes/laneOffset")]
    sections = list(road.iterfind("lanes/laneSection"))
    length = read_number(path, road, "length")
    if len(sections) != 1 or len(offsets) > 1 or any(map(any, (o[1:] for o in offsets))) or length < MIN_ROAD_M:
        return
    x, y, yaw = compute_pose(path, road, length / 2)
    for side, sign in (("right", -1), ("left", 1)):
        lanes = sorted(sections[0].iterfind(f"{side}/lane"), key=lambda lane: abs(read_number(path, lane, "id")))
        inner = _measure_inner_lane(path, lanes)
        if inner is not None:
            t = (offsets[0][0] if offsets else 0.0) + sign * inner
            yield x - t * math.sin(yaw), y + t * math.cos(yaw)


def _measure_inner_lane(path: Path, lanes: Sequence[Element]) -> float | None:
    """Return how far [m] the middle of the first driving lane is from the innermost one's inner border.

    None if there is no such lane, or if a width on the way changes.
    """
    inside = 0.0
    for lane in lanes:
        widths = [[read_number(path, width, name) for name in "abcd"] for width in lane.iterfind("width")]
        if len(widths) != 1 or any(widths[0][1:]):
            return None
        width = widths[0][0]
        if lane.get("type") == "driving" and width >= MIN_WIDTH_M:
            return inside + width / 2
        inside += width
    return None


@dataclass(frozen=True, slots=True)
class LaneGaps:
    """Gaps between middles of lanes of the map and the nearest lane of the net."""

    median_m: float
    """The error of the offset; NaN if the map has no suitable road (`_find_lane_middles`)."""
    measured: int
    displaced: int
    """Lanes over `DISPLACED_M` off: netconvert leaves out lanes that are not for cars, and moves some of the others."""


def measure_lane_gaps(middles: Float, roads: RoadMap, offset: tuple[float, float]) -> LaneGaps:
    """Measure a round trip of the offset, at `OpenDriveMap.lane_middles`."""
    if not len(middles):
        return LaneGaps(math.nan, 0, 0)
    gaps = roads.find_nearest_lanes(middles + np.array(offset)).distance
    return LaneGaps(float(np.median(gaps)), len(gaps), int((gaps > DISPLACED_M).sum()))


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
