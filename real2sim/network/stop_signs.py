"""Place stop lines and signs on a planned network: boxes for network.json, node types, edge priorities."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.roads import StopSignBox
from real2sim.carla.opendrive import STOP_BOX_M
from real2sim.hd_map import HdMap, LaneKind, StopLine
from real2sim.network.lane_segment import LaneSegment, compute_yaw_difference
from real2sim.network.network_plan import NetworkPlan
from real2sim.polylines import PolylineIndex

STOP_LINE_REACH_M = 1.0
"""[m] A stop line applies to lanes whose centre line is this close."""
MIN_LINE_STATION_M = 1.0
"""[m] Minimum arc length of a stop line: a lane that begins at the line is not stopped by it."""
ACROSS_RAD = np.radians(50)
"""A stop line lies across its lane: a lane at a larger angle to it is another one's."""
PRIORITY: Mapping[str, int] = {"stop": 1, "yield": 2, "": 3}
"""Priority of an edge by the sign at its end; netconvert compares them only."""


class LineStation(NamedTuple):
    """A stop line on a lane."""

    sign: str
    """Its meaning, see `StopLine.sign`."""
    s: float
    """Arc length [m] on the lane."""


StopsBySegment = Mapping[str, list[LineStation]]
"""Segment id -> the stop lines on it."""


def place_stop_lines(plan: NetworkPlan, map: HdMap) -> StopsBySegment:
    """Assign stop lines to the lanes of edges."""
    segments = [lane for edge in plan.edges for lane in edge.lanes if lane.kind is LaneKind.DRIVING]
    tree = PolylineIndex([segment.centreline for segment in segments]).tree
    stops: defaultdict[str, list[LineStation]] = defaultdict(list)
    for line in map.stop_lines:
        near = tree.query(shapely.LineString(line.line), predicate="dwithin", distance=STOP_LINE_REACH_M)
        for segment, s in _find_crossed_segments(line, [segments[i] for i in sorted(near)]):
            stops[segment.id].append(LineStation(line.sign, s))
    return dict(stops)


def _find_crossed_segments(line: StopLine, near: Iterable[LaneSegment]) -> list[tuple[LaneSegment, float]]:
    """Return lanes that cross the line; only those that the map names, if it names any of them."""
    x, y = line.line.mean(0)
    yaw = float(np.arctan2(*(line.line[1] - line.line[0])[::-1])) + np.pi / 2
    crossed: list[tuple[LaneSegment, float]] = []
    for segment in near:
        s = min(segment.centreline.project(float(x), float(y))[0], segment.centreline.length)
        turn = compute_yaw_difference(segment.centreline.yaw_at(s), yaw)
        if s >= MIN_LINE_STATION_M and min(turn, np.pi - turn) <= ACROSS_RAD:
            crossed.append((segment, s))
    named = [(segment, s) for segment, s in crossed if segment.source_lane in line.lanes]
    return named or crossed


def build_stop_boxes(stops: StopsBySegment, lane_ids: Mapping[str, str]) -> tuple[StopSignBox, ...]:
    """Build one box on every lane before a line with a stop sign."""
    return tuple(
        StopSignBox(id=f"stop_{lane_ids[id_]}", lane=lane_ids[id_], line_pos_m=round(line.s, 3), length_m=STOP_BOX_M)
        for id_, lines in sorted(stops.items())
        for line in lines[-1:]
        if line.sign == "stop"
    )


def derive_right_of_way(plan: NetworkPlan, stops: StopsBySegment) -> tuple[dict[int, str], dict[str, int]]:
    """Return node types with stop signs, and edge priorities by the id of the rightmost segment."""
    types: dict[int, str] = {}
    priority: dict[str, int] = {}
    entries: defaultdict[int, list[str]] = defaultdict(list)
    for edge in plan.edges:
        signs = {line.sign for lane in edge.lanes for line in stops.get(lane.id, ())}
        sign = "stop" if "stop" in signs else "yield" if "yield" in signs else ""
        priority[edge.lanes[0].id] = PRIORITY[sign]
        entries[edge.end].append(sign)
    for node, signs in entries.items():
        if "stop" in signs:
            types[node] = "allway_stop" if set(signs) == {"stop"} and len(signs) > 1 else "priority_stop"
    return types, priority
