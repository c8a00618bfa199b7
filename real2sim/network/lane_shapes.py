"""Restore the planned centre lines in a compiled net.

netconvert cuts every lane, even one with a given shape, at the outline that it computes for the junction, and where
outlines overlap it leaves stumps of 0.2 m. Lanes of a log end where the map says, so their shapes are restored.
"""

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads.netconvert import strip_xml_comments
from real2sim.network.lane_segment import clip_polyline
from real2sim.network.network_plan import NetworkPlan, PlannedConnection
from real2sim.xml_file import Element

MIN_LANE_LENGTH_M = 0.1
"""[m] SUMO's minimum length of a lane."""


def restore_shapes(net: bytes, plan: NetworkPlan, lane_ids: Mapping[str, str]) -> bytes:
    """Return the net with the planned shapes and without comments. `lane_ids`: segment id -> SUMO lane id."""
    root = ElementTree.fromstring(strip_xml_comments(net))
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    for edge in plan.edges:
        length = float(
            np.mean([segment.centreline.length for segment in edge.lanes])
        )  # SUMO has one length for all lanes
        for segment in edge.lanes:
            _set_shape(lanes[lane_ids[segment.id]], segment.centreline.xy, length)
    ends = {segment.id: segment.centreline.xy for edge in plan.edges for segment in edge.lanes}
    chains = _collect_internal_lanes(root)
    for connection in plan.connections:
        chain = [lanes[id_] for id_ in chains.get((lane_ids[connection.start], lane_ids[connection.goal]), ())]
        _restore_connection(chain, connection, ends)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _set_shape(lane: Element, xy: Float, length: float) -> None:
    lane.set("shape", format_shape(xy))
    lane.set("length", f"{max(length, MIN_LANE_LENGTH_M):.3f}")


def format_shape(xy: Float) -> str:
    """Return points in SUMO's text format."""
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in xy)


def _collect_internal_lanes(root: Element) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the internal lanes between two lanes: one, or two where vehicles wait inside the junction."""
    onward: dict[str, str] = {}
    connections: list[tuple[str, str, str]] = []
    for connection in root.iter("connection"):
        start = f"{connection.get('from')}_{connection.get('fromLane')}"
        via = connection.get("via", "")
        if start.startswith(":"):
            onward[start] = via
        else:
            connections.append((start, f"{connection.get('to')}_{connection.get('toLane')}", via))
    return {(start, goal): tuple(_follow_vias(via, onward)) for start, goal, via in connections}


def _follow_vias(via: str, onward: Mapping[str, str]) -> Iterable[str]:
    while via:
        yield via
        via = onward.get(via, "")


def _restore_connection(chain: list[Element], connection: PlannedConnection, ends: Mapping[str, Float]) -> None:
    if not chain:
        return
    if connection.shape is None:
        gap = np.stack((ends[connection.start][-1], ends[connection.goal][0]))
        for lane in chain:
            _set_shape(lane, gap, MIN_LANE_LENGTH_M)
        return
    bounds = [0.0, *(_find_station(lane, connection.shape) for lane in chain[:-1]), connection.shape.length]
    for lane, begin, end in zip(chain, bounds, bounds[1:], strict=False):
        _set_shape(lane, clip_polyline(connection.shape, begin, end).xy, end - begin)


def _find_station(lane: Element, line: Polyline) -> float:
    """Return the arc length where an internal lane ends, off both ends so that both parts have a length."""
    x, y = (float(value) for value in lane.get("shape", "").split()[-1].split(",")[:2])
    return min(max(line.project(x, y)[0], MIN_LANE_LENGTH_M), line.length - MIN_LANE_LENGTH_M)
