"""Write a plan as SUMO's plain XML (nodes, edges, connections) and compile it with netconvert."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import write_bytes
from mdrive_sumo.roads.netconvert import run_netconvert
from real2sim.hd_map import LaneKind
from real2sim.network.lane_segment import LaneSegment
from real2sim.network.lane_shapes import format_shape
from real2sim.network.network_plan import NetworkPlan, PlannedEdge
from real2sim.xml_file import Element

ALLOW: Mapping[LaneKind, str] = {LaneKind.DRIVING: "", LaneKind.BIKE: "bicycle", LaneKind.SIDEWALK: "pedestrian"}
"""SUMO's vehicle classes on a lane of this kind; "": all but pedestrians."""


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


def assign_lane_indices(plan: NetworkPlan, left_hand: bool) -> dict[str, tuple[str, int]]:
    """Return segment id -> edge id (named after the rightmost lane) and lane index from the kerb."""
    return {
        lane.id: (f"e{to_sumo_id(edge.lanes[0].id)}", len(edge.lanes) - 1 - k if left_hand else k)
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


def _build_edge(edge: PlannedEdge, index: Mapping[str, tuple[str, int]], priority: Mapping[str, int]) -> Element:
    name = index[edge.lanes[0].id][0]
    middle = edge.lanes[len(edge.lanes) // 2].centreline.xy
    element = _build_element(
        "edge",
        id=name,
        **{"from": f"n{edge.begin}", "to": f"n{edge.end}"},
        numLanes=str(len(edge.lanes)),
        priority=str(priority.get(edge.lanes[0].id, 1)),
        spreadType="center",
        shape=format_shape(middle),
    )
    element.extend(sorted((_build_lane(lane, index[lane.id][1]) for lane in edge.lanes), key=_get_index))
    return element


def _get_index(element: Element) -> int:
    return int(element.get("index", "0"))


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


def _build_connections(plan: NetworkPlan, index: Mapping[str, tuple[str, int]]) -> Iterable[Element]:
    silent = {name for name, _ in index.values()}
    for connection in plan.connections:
        (start, start_lane), (goal, goal_lane) = index[connection.start], index[connection.goal]
        silent.discard(start)
        shape = {} if connection.shape is None else {"shape": format_shape(connection.shape.xy)}
        yield _build_element(
            "connection",
            **{"from": start, "to": goal, "fromLane": str(start_lane), "toLane": str(goal_lane)},
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
