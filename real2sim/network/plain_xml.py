"""Write a plan as SUMO's plain XML (nodes, edges, connections), compile it with netconvert and restore its shapes.

netconvert cuts every lane, even one with a given shape, at the outline that it computes for the junction, and where
outlines overlap it leaves stumps of 0.2 m. Lanes of a log end where the map says, so their shapes are restored.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.output_files import write_bytes
from mdrive_sumo.roads.netconvert import run_netconvert, strip_xml_comments
from real2sim.hd_map import LaneKind
from real2sim.network.lane_segment import LaneSegment, clip_polyline
from real2sim.network.network_plan import NetworkPlan, PlannedConnection, PlannedEdge
from real2sim.xml_file import Element

ALLOW: Mapping[LaneKind, str] = {LaneKind.DRIVING: "", LaneKind.BIKE: "bicycle", LaneKind.SIDEWALK: "pedestrian"}
"""SUMO's vehicle classes on a lane of this kind; "": all but pedestrians."""
MIN_LANE_LENGTH_M = 0.1
"""[m] SUMO's minimum length of a lane."""


def build_plain_arguments(left_hand: bool) -> tuple[str, ...]:
    """Return netconvert's arguments, relative to the folder of the plain files."""
    return (
        *("--node-files", "plain.nod.xml", "--edge-files", "plain.edg.xml", "--connection-files", "plain.con.xml"),
        *("--no-turnarounds", "true", "--offset.disable-normalization", "true", "--precision", "3"),
        *("--junctions.limit-turn-speed", "-1", "--no-internal-links", "false", "--geometry.max-angle", "-1"),
        *(("--lefthand", "true") if left_hand else ()),
    )


def to_sumo_id(id_: str) -> str:
    """Return an id that SUMO accepts."""
    return re.sub(r"[^A-Za-z0-9_.~-]", "_", id_).lstrip(":") or "_"


class LaneIndex(NamedTuple):
    """Where a segment becomes a lane."""

    edge: str
    """Id of the edge, named after its rightmost lane."""
    number: int
    """Index of the lane from the kerb."""

    @property
    def lane_id(self) -> str:
        """SUMO's id of the lane."""
        return f"{self.edge}_{self.number}"


def assign_lane_indices(plan: NetworkPlan, left_hand: bool) -> dict[str, LaneIndex]:
    """Return the lane of every segment of an edge, by segment id."""
    return {
        lane.id: LaneIndex(f"e{to_sumo_id(edge.lanes[0].id)}", len(edge.lanes) - 1 - k if left_hand else k)
        for edge in plan.edges
        for k, lane in enumerate(edge.lanes)
    }


def write_plain(
    plan: NetworkPlan, types: Mapping[int, str], priority: Mapping[str, int], left_hand: bool, folder: Path
) -> None:
    """Write plain.nod.xml, plain.edg.xml and plain.con.xml. `priority` is by the rightmost segment of an edge."""
    index = assign_lane_indices(plan, left_hand)
    _save(folder / "plain.nod.xml", "nodes", _build_nodes(plan, types))
    _save(folder / "plain.edg.xml", "edges", (_build_edge(e, index, priority) for e in plan.edges))
    _save(folder / "plain.con.xml", "connections", _build_connections(plan, index))


def _save(path: Path, root: str, elements: Iterable[Element]) -> None:
    tree = ElementTree.Element(root)
    tree.extend(elements)
    ElementTree.indent(tree)
    write_bytes(path, ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True) + b"\n")


def _build_nodes(plan: NetworkPlan, types: Mapping[int, str]) -> Iterable[Element]:
    ends: defaultdict[int, list[Float]] = defaultdict(list)
    for edge in plan.edges:
        ends[edge.begin] += [lane.start for lane in edge.lanes]
        ends[edge.end] += [lane.end for lane in edge.lanes]
    for node, points in sorted(ends.items()):
        x, y = np.mean(points, axis=0)
        yield _build_element("node", id=f"n{node}", x=f"{x:.3f}", y=f"{y:.3f}", type=types.get(node, "priority"))


def _build_edge(edge: PlannedEdge, index: Mapping[str, LaneIndex], priority: Mapping[str, int]) -> Element:
    middle = edge.lanes[len(edge.lanes) // 2].centreline.xy
    element = _build_element(
        "edge",
        id=index[edge.lanes[0].id].edge,
        **{"from": f"n{edge.begin}", "to": f"n{edge.end}"},
        numLanes=str(len(edge.lanes)),
        priority=str(priority.get(edge.lanes[0].id, 1)),
        spreadType="center",
        shape=format_shape(middle),
    )
    by_index = sorted(edge.lanes, key=lambda lane: index[lane.id].number)
    element.extend(_build_lane(lane, index[lane.id].number) for lane in by_index)
    return element


def _build_lane(lane: LaneSegment, index: int) -> Element:
    permission = {"allow": allow} if (allow := ALLOW[lane.kind]) else {"disallow": "pedestrian"}
    return _build_element(
        "lane",
        index=str(index),
        speed=f"{lane.speed:.2f}",
        width=f"{lane.width:.2f}",
        shape=format_shape(lane.centreline.xy),
        **permission,
    )


def _build_connections(plan: NetworkPlan, index: Mapping[str, LaneIndex]) -> Iterable[Element]:
    silent = {lane.edge for lane in index.values()}
    for connection in plan.connections:
        start, goal = index[connection.start], index[connection.goal]
        silent.discard(start.edge)
        shape = {} if connection.shape is None else {"shape": format_shape(connection.shape.xy)}
        yield _build_element(
            "connection",
            **{"from": start.edge, "to": goal.edge, "fromLane": str(start.number), "toLane": str(goal.number)},
            speed=f"{connection.speed:.2f}",
            **shape,
        )
    for name in sorted(silent):  # otherwise netconvert guesses where it leads
        yield _build_element("connection", **{"from": name})


def _build_element(tag: str, **attributes: str) -> Element:
    return ElementTree.Element(tag, attributes)


def compile_plain(folder: Path, left_hand: bool) -> bytes:
    """Compile the plain files in `folder` with netconvert; raise InputError."""
    return run_netconvert(build_plain_arguments(left_hand), folder, f"{folder}: expected a network")


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
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in xy.tolist())


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
