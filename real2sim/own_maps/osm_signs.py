"""Stop and give-way signs of an OpenStreetMap extract: the approaches of junctions that they stand at."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import Lane, RoadMap, StopSignBox
from mdrive_sumo.roads.network_file import YieldSign
from real2sim.carla.opendrive import STOP_BOX_M
from real2sim.readers.osm_file import OsmFile, OsmWay
from real2sim.xml_file import Element

SIGN_REACH_M = 50.0
"""[m] A sign stands at most this far before its junction: OpenStreetMap asks for the place of the line."""
BESIDE_M = 10.0
"""[m] From a sign, which lies on the line of the road, to the lane of its approach."""
JUNCTION_REACH_M = 20.0
"""[m] From the middle of a junction to the ends of its approaches."""
ALONG_RAD = np.radians(50)
"""[rad] Largest difference between the directions of the way and the lane at a sign."""
SIGNED_PRIORITY, UNSIGNED_PRIORITY = 0, 20
"""Priorities of edges; netconvert compares them only. SUMO's table for OpenStreetMap has 1 to 14."""

SignKind = Literal["stop", "give_way"]


@dataclass(frozen=True, slots=True)
class RoadSign:
    """A sign on a way."""

    node: str
    kind: SignKind
    xy: Float
    yaw: float
    """Direction [rad] of the way there."""
    direction: str
    """"forward", "backward" along the way, or "" where the map does not say."""
    is_at_junction: bool
    """Whether it is the node of a junction itself, which stands for all approaches."""


@dataclass(frozen=True)
class SignedApproaches:
    """What the signs of an extract say about the edges of a net."""

    sign_by_edge: Mapping[str, SignKind]
    unplaced: int
    """Signs without an approach."""


def find_signs(osm: OsmFile, root: Element) -> Iterator[RoadSign]:
    """Yield the signs that stand on ways for cars."""
    tags = {
        node.get("id", ""): {tag.get("k", ""): tag.get("v", "") for tag in node.iter("tag")}
        for node in root.iter("node")
        if node.find("tag") is not None
    }
    uses: defaultdict[str, int] = defaultdict(int)
    roads = [way for way in osm.ways.values() if "highway" in way.tags]
    for way in roads:
        for place, node in enumerate(way.nodes):
            uses[node] += 1 + (0 < place < len(way.nodes) - 1)
    done: set[str] = set()
    for way in roads:
        for place, node in enumerate(way.nodes):
            kind = tags.get(node, {}).get("highway")
            if (kind == "stop" or kind == "give_way") and node not in done:
                done.add(node)
                about = tags[node]
                direction = about.get("direction") or about.get(f"{kind}:direction") or ""
                is_at_junction = uses[node] > 2 and about.get("stop") == "all"
                yield RoadSign(
                    node, kind, osm.nodes[node], _compute_yaw(osm, way, place),
                    direction if direction in ("forward", "backward") else "", is_at_junction,
                )  # fmt: skip


def _compute_yaw(osm: OsmFile, way: OsmWay, place: int) -> float:
    before, after = osm.nodes[way.nodes[max(place - 1, 0)]], osm.nodes[way.nodes[min(place + 1, len(way.nodes) - 1)]]
    return float(np.arctan2(*(after - before)[::-1]))


def place_signs(signs: Iterator[RoadSign], roads: RoadMap) -> SignedApproaches:
    """Return the sign of each edge that has one at its end."""
    found: dict[str, SignKind] = {}
    unplaced = 0
    for sign in signs:
        edges = _find_edges(sign, roads)
        unplaced += not edges
        for edge in edges:
            found[edge] = "stop" if "stop" in (sign.kind, found.get(edge)) else "give_way"
    return SignedApproaches(found, unplaced)


def _find_edges(sign: RoadSign, roads: RoadMap) -> set[str]:
    """Return the edges that a sign stands at the end of: the nearest that leads its way, or all of a junction."""
    x, y = sign.xy.tolist()
    ends: dict[str, float] = {}
    for lane in roads.find_lanes_near(x, y, JUNCTION_REACH_M if sign.is_at_junction else BESIDE_M):
        if lane.junction or not any(roads.lanes[after].junction for after in lane.successors):
            continue
        rest = lane.centre.length - lane.centre.project(x, y)[0]
        if sign.is_at_junction:
            if np.hypot(*(lane.centre.xy[-1] - sign.xy)) <= JUNCTION_REACH_M:
                ends[lane.edge] = 0.0
        elif rest <= SIGN_REACH_M and _leads_its_way(sign, lane):
            ends[lane.edge] = min(rest, ends.get(lane.edge, np.inf))
    if sign.is_at_junction or not ends:
        return set(ends)
    return {min(ends, key=lambda edge: ends[edge])}


def _leads_its_way(sign: RoadSign, lane: Lane) -> bool:
    s = min(max(lane.centre.project(*sign.xy.tolist())[0], 0.0), lane.centre.length)
    turn = abs(np.angle(np.exp(1j * (lane.centre.yaw_at(s) - sign.yaw))))
    along, against = turn <= ALONG_RAD, turn >= np.pi - ALONG_RAD
    return bool(along if sign.direction == "forward" else against if sign.direction == "backward" else along or against)


def derive_right_of_way(approaches: SignedApproaches, net: Element) -> tuple[dict[str, int], dict[str, str]]:
    """Return priorities by edge and types by node, of the junctions with signs."""
    end_by_edge = {edge.get("id", ""): edge.get("to", "") for edge in net.iter("edge") if not edge.get("function")}
    lights = {node.get("id") for node in net.iter("junction") if node.get("type", "").startswith("traffic_light")}
    into: defaultdict[str, list[str]] = defaultdict(list)
    for edge, end in end_by_edge.items():
        into[end].append(edge)
    priority: dict[str, int] = {}
    types: dict[str, str] = {}
    for end in {end_by_edge[edge] for edge in approaches.sign_by_edge} - lights:
        signs = {edge: approaches.sign_by_edge.get(edge, "") for edge in into[end] if _is_for_cars(net, edge)}
        priority |= {edge: SIGNED_PRIORITY if sign else UNSIGNED_PRIORITY for edge, sign in signs.items()}
        has_stop = "stop" in signs.values()
        is_all = set(signs.values()) == {"stop"} and len(signs) > 1
        types[end] = "allway_stop" if is_all else "priority_stop" if has_stop else "priority"
    return dict(sorted(priority.items())), dict(sorted(types.items()))


def _is_for_cars(net: Element, edge: str) -> bool:
    element = next(one for one in net.iter("edge") if one.get("id") == edge)
    return any("passenger" in lane.get("allow", "passenger") for lane in element.iter("lane"))


def build_yield_signs(approaches: SignedApproaches, roads: RoadMap) -> tuple[YieldSign, ...]:
    """Return a sign on every lane that ends at a give-way sign."""
    return tuple(
        YieldSign(id=f"yield_{lane.id}", lane=lane.id, line_pos_m=round(lane.centre.length, 3))
        for lane in roads.driving
        if approaches.sign_by_edge.get(lane.edge) == "give_way" and not lane.junction
    )


def build_stop_boxes(approaches: SignedApproaches, roads: RoadMap) -> tuple[StopSignBox, ...]:
    """Return a box on every lane that ends at a stop sign."""
    return tuple(
        StopSignBox(id=f"stop_{lane.id}", lane=lane.id, line_pos_m=round(lane.centre.length, 3), length_m=STOP_BOX_M)
        for lane in roads.driving
        if approaches.sign_by_edge.get(lane.edge) == "stop" and not lane.junction
    )
