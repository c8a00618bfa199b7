"""Left-hand maps: netconvert's importer puts lanes of OpenDRIVE on the right of the road, whatever the rule says.

The mirror image of a left-hand map is a right-hand map. It is compiled, and the network is mirrored back.
"""

from collections.abc import Mapping
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from real2sim.xml_file import Element, read_number

MIRRORED: Mapping[str, tuple[str, ...]] = {
    "geometry": ("y", "hdg"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": ("a", "b", "c", "d"),
    "paramPoly3": ("aV", "bV", "cV", "dV"),
    "laneOffset": ("a", "b", "c", "d"),
    "border": ("a", "b", "c", "d"),
    "superelevation": ("a", "b", "c", "d"),
    "signal": ("t", "hOffset"),
    "signalReference": ("t",),
    "object": ("t", "hdg"),
    "offset": ("y", "hdg"),
}
"""Attributes that change sign when y does. Lanes change sides besides."""
OTHER_SIDE = {"left": "right", "right": "left"}
OTHER_TURN = {"l": "r", "r": "l", "L": "R", "R": "L", "t": "T", "T": "t"}
"""Directions of connections in a SUMO net; T is a turn back where traffic keeps left."""


def is_left_hand_map(path: Path, root: Element) -> bool:
    """Return whether traffic keeps left; raise InputError for a map with both rules or another one."""
    rules: dict[str, str] = {}
    for road in root.iter("road"):
        rule = road.get("rule", "")
        if rule not in ("", "RHT", "LHT"):
            raise InputError(f"{path}: road {road.get('id')}: rule: expected RHT or LHT, found {rule!r}")
        rules[rule] = road.get("id", "")
    if {"RHT", "LHT"} <= rules.keys():
        raise InputError(
            f"{path}: expected roads of one rule, found LHT and RHT (roads {rules['LHT']} and {rules['RHT']})"
        )
    return "LHT" in rules


def mirror_map(path: Path, root: Element) -> None:
    """Mirror a map at the x axis, in place; raise InputError for lanes without a number."""
    for element in root.iter():
        for name in MIRRORED.get(element.tag, ()):
            if element.get(name) is not None:
                element.set(name, repr(-read_number(path, element, name)))
    for section in root.iter("laneSection"):
        _swap_sides(path, section)
    for link in root.iter("laneLink"):
        for name in ("from", "to"):
            _negate_lane(path, link, name)
    for road in root.iter("road"):
        road.attrib.pop("rule", None)


def _swap_sides(path: Path, section: Element) -> None:
    for side in section:
        side.tag = OTHER_SIDE.get(side.tag, side.tag)
    for lane in section.iter("lane"):
        _negate_lane(path, lane, "id")
        for link in lane.iterfind("link/*"):
            _negate_lane(path, link, "id")


def _negate_lane(path: Path, element: Element, name: str) -> None:
    element.set(name, str(-round(read_number(path, element, name))))


def mirror_net(net: Element) -> None:
    """Mirror a compiled net at the middle of its height, in place, and mark it as left-hand.

    Lane 0 of an edge stays the outer one, as SUMO numbers lanes in left-hand nets.
    """
    net.set("lefthand", "true")
    location = net.find("location")
    assert location is not None  # netconvert writes one
    _, low, _, high = (float(part) for part in location.get("convBoundary", "").split(","))
    total = low + high
    x, y = (float(part) for part in location.get("netOffset", "").split(","))
    location.set("netOffset", f"{x:.3f},{total - y:.3f}")
    left, bottom, right, top = location.get("origBoundary", "").split(",")
    location.set("origBoundary", f"{left},{-float(top):.3f},{right},{-float(bottom):.3f}")
    for element in net.iter():
        if element.get("shape"):
            element.set("shape", " ".join(_mirror_point(point, total) for point in element.get("shape", "").split()))
        if element.tag == "junction":
            element.set("y", f"{total - float(element.get('y', 'nan')):.3f}")
        if element.tag == "connection" and element.get("dir") in OTHER_TURN:
            element.set("dir", OTHER_TURN[element.get("dir", "")])


def _mirror_point(point: str, total: float) -> str:
    x, y, *z = point.split(",")
    return ",".join((x, f"{total - float(y):.3f}", *z))
