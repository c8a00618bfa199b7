"""Direct junctions of OpenDRIVE 1.7, in which roads meet without a road between them, for netconvert."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from real2sim.carla.reference_line import compute_pose
from real2sim.xml_file import Element, read_number

CONNECTOR_M = 0.1
"""[m] Length of the roads that are put in: SUMO's least length of a lane."""


def replace_direct_junctions(path: Path, root: Element) -> Iterator[str]:
    """Put a short connecting road into every connection of a direct junction, in place; yield the changes."""
    roads = {road.get("id", ""): road for road in root.iter("road")}
    for junction in root.iter("junction"):
        if junction.get("type") != "direct":
            continue
        count = 0
        for connection in junction.findall("connection"):
            incoming, linked = (roads.get(connection.get(name, "")) for name in ("incomingRoad", "linkedRoad"))
            if incoming is not None and linked is not None:
                id_ = f"{junction.get('id')}_{connection.get('id')}"
                while id_ in roads:
                    id_ += "_"
                roads[id_] = _build_connector(path, id_, junction, connection, (incoming, linked))
                root.insert(list(root).index(junction), roads[id_])
                count += 1
        del junction.attrib["type"]
        yield f"junction {junction.get('id')}: {count} connecting roads of {CONNECTOR_M} m put in"


def _build_connector(
    path: Path, id_: str, junction: Element, connection: Element, ends: tuple[Element, Element]
) -> Element:
    """Return a road that begins where the traffic of the incoming road meets the junction."""
    incoming, linked = ends
    leaves_at_end = _leads_to(incoming, "successor", junction)
    s = read_number(path, incoming, "length") if leaves_at_end else 0.0
    x, y, yaw = compute_pose(path, incoming, s)
    yaw = yaw if leaves_at_end else yaw + math.pi
    road = ElementTree.Element(
        "road", {"id": id_, "name": "", "length": repr(CONNECTOR_M), "junction": junction.get("id", "")}
    )
    links = ElementTree.SubElement(road, "link")
    contact = connection.get("contactPoint", "start")
    for tag, other, at in (
        ("predecessor", incoming, "end" if leaves_at_end else "start"),
        ("successor", linked, contact),
    ):
        attributes = {"elementType": "road", "elementId": other.get("id", ""), "contactPoint": at}
        ElementTree.SubElement(links, tag, attributes)
    plan = ElementTree.SubElement(road, "planView")
    place = {"s": "0", "x": repr(x), "y": repr(y), "hdg": repr(yaw), "length": repr(CONNECTOR_M)}
    ElementTree.SubElement(ElementTree.SubElement(plan, "geometry", place), "line")
    _add_lanes(road, connection)
    connection.set("connectingRoad", id_)
    connection.set("contactPoint", "start")
    del connection.attrib["linkedRoad"]
    return road


def _leads_to(road: Element, tag: str, junction: Element) -> bool:
    link = road.find(f"link/{tag}")
    return link is not None and (link.get("elementType"), link.get("elementId")) == ("junction", junction.get("id"))


def _add_lanes(road: Element, connection: Element) -> None:
    """Add a lane for every pair of linked lanes, and let the connection lead into it."""
    section = ElementTree.SubElement(ElementTree.SubElement(road, "lanes"), "laneSection", {"s": "0"})
    center = ElementTree.SubElement(section, "center")
    ElementTree.SubElement(center, "lane", {"id": "0", "type": "none", "level": "false"})
    right = ElementTree.SubElement(section, "right")
    pairs = sorted(connection.findall("laneLink"), key=lambda pair: abs(int(pair.get("from", "0"))))
    for k, pair in enumerate(pairs, 1):
        lane = ElementTree.SubElement(right, "lane", {"id": str(-k), "type": "driving", "level": "false"})
        links = ElementTree.SubElement(lane, "link")
        ElementTree.SubElement(links, "predecessor", {"id": pair.get("from", "")})
        ElementTree.SubElement(links, "successor", {"id": pair.get("to", "")})
        ElementTree.SubElement(lane, "width", {"sOffset": "0", "a": "3.5", "b": "0", "c": "0", "d": "0"})
        pair.set("to", str(-k))
