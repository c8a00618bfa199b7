"""Stop lines and signs of a map on the planned network: boxes for network.json, types of nodes, priority of edges."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
import shapely

from mdrive_sumo.roads import StopSignBox
from real2sim.carla.opendrive import STOP_BOX_M
from real2sim.hd_map import HdMap, LaneKind, StopLine
from real2sim.network.lane_segment import LaneSegment, compute_yaw_difference
from real2sim.network.network_plan import NetworkPlan
from real2sim.polylines import PolylineIndex

REACH_M = 1.0
"""A stop line concerns lanes whose centre line comes this close to it."""
AHEAD_M = 1.0
"""It lies at least this far along the lane: a lane that begins at the line is not stopped by it."""
ACROSS_RAD = np.radians(50)
PRIORITY: Mapping[str, int] = {"stop": 1, "yield": 2, "": 3}
StopsBySegment = Mapping[str, list[tuple[str, float]]]
"""Strip id -> signs before it ends, with the arc length [m] of the line."""


def place_stop_lines(plan: NetworkPlan, map: HdMap) -> dict[str, list[tuple[str, float]]]:
    """Which stop lines lie on which lanes of edges."""
    strips = [lane for edge in plan.edges for lane in edge.lanes if lane.kind is LaneKind.DRIVING]
    tree = PolylineIndex([strip.line for strip in strips]).tree
    stops: defaultdict[str, list[tuple[str, float]]] = defaultdict(list)
    for line in map.stop_lines:
        near = tree.query(shapely.LineString(line.line), predicate="dwithin", distance=REACH_M)
        for strip, s in _find_crossed_segments(line, [strips[i] for i in sorted(near)]):
            stops[strip.id].append((line.sign, s))
    return dict(stops)


def _find_crossed_segments(line: StopLine, near: Iterable[LaneSegment]) -> list[tuple[LaneSegment, float]]:
    """Lanes that run across the line; of those only the ones that the map names, if it names any of them."""
    x, y = line.line.mean(0)
    yaw = float(np.arctan2(*(line.line[1] - line.line[0])[::-1])) + np.pi / 2
    found: list[tuple[LaneSegment, float]] = []
    for strip in near:
        s = min(strip.line.project(float(x), float(y))[0], strip.line.length)
        turn = compute_yaw_difference(strip.line.yaw_at(s), yaw)
        if s >= AHEAD_M and min(turn, np.pi - turn) <= ACROSS_RAD:
            found.append((strip, s))
    named = [(strip, s) for strip, s in found if strip.lane in line.lanes]
    return named or found


def build_stop_boxes(stops: StopsBySegment, lane_ids: Mapping[str, str]) -> tuple[StopSignBox, ...]:
    """One box on every lane before a line with a stop sign."""
    return tuple(
        StopSignBox(id=f"stop_{lane_ids[id_]}", lane=lane_ids[id_], line_pos_m=round(s, 3), length_m=STOP_BOX_M)
        for id_, signs in sorted(stops.items())
        for sign, s in signs[-1:]
        if sign == "stop"
    )


def derive_right_of_way(plan: NetworkPlan, stops: StopsBySegment) -> tuple[dict[int, str], dict[str, int]]:
    """Types of nodes with stop signs, and priority of edges by their rightmost lane's strip id."""
    types: dict[int, str] = {}
    priority: dict[str, int] = {}
    entries: defaultdict[int, list[str]] = defaultdict(list)
    for edge in plan.edges:
        signs = {sign for lane in edge.lanes for sign, _ in stops.get(lane.id, ())}
        sign = "stop" if "stop" in signs else "yield" if "yield" in signs else ""
        priority[edge.lanes[0].id] = PRIORITY[sign]
        entries[edge.end].append(sign)
    for node, signs in entries.items():
        if "stop" in signs:
            types[node] = "allway_stop" if set(signs) == {"stop"} and len(signs) > 1 else "priority_stop"
    return types, priority
