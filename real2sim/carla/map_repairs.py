"""Repair OpenDRIVE maps of which netconvert refuses a detail that does not change where the lanes lie."""

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from real2sim.carla.reference_line import compute_pose
from real2sim.xml_file import Element, read_number

ROUNDING_M = 0.01
"""[m] Signals at the end of a road lie behind it by the last digits of their place."""
NO_LIMITS = ("no limit", "undefined")
"""Words that the standard allows for a speed. netconvert reads them for a road, not for a lane."""
FORBIDDEN = re.compile(r"""[\s|\\'";,<>&!:*?/]""")
"""Characters that ids in SUMO must not have, and the separators that it uses for some of them."""
Repairs = Iterator[str]
ENDS = {"start": "predecessor", "end": "successor"}
"""Contact point of a road -> the name of its link there."""
CONTACTS = {link: contact for contact, link in ENDS.items()}
CONNECTOR_M = 0.1
"""[m] Length of the roads that are put in: SUMO's least length of a lane."""


def repair_map(path: Path, root: Element) -> tuple[str, ...]:
    """Repair a map in place and return the changes; raise InputError for what has no meaning."""
    _check_ids(path, root)
    return tuple(change for step in _STEPS for change in step(path, root))


def _link_back(_: Path, root: Element) -> Repairs:
    yield from repair_road_links(root)


def _check_ids(path: Path, root: Element) -> None:
    ids = [road.get("id", "") for road in root.iter("road")]
    twice = next((id_ for id_ in ids if ids.count(id_) > 1), None) if len(set(ids)) < len(ids) else None
    if twice is not None:
        raise InputError(f"{path}: expected roads of different ids, found {twice} twice")


def _rename(_: Path, root: Element) -> Repairs:
    """Rename roads and junctions whose ids SUMO does not take."""
    for tag in ("road", "junction"):
        taken = {element.get("id", "") for element in root.iter(tag)}
        names: dict[str, str] = {}
        for id_ in sorted(name for name in taken if FORBIDDEN.search(name)):
            names[id_] = FORBIDDEN.sub("_", id_)
            while names[id_] in taken:
                names[id_] += "_"
            taken.add(names[id_])
            yield f"{tag} {id_}: renamed {names[id_]}"
        for element, attribute in _list_references(root, tag) if names else ():
            element.set(attribute, names.get(element.get(attribute, ""), element.get(attribute, "")))


def _list_references(root: Element, tag: str) -> Iterator[tuple[Element, str]]:
    """Yield the elements and attributes that hold ids of roads, or of junctions."""
    names = ("incomingRoad", "connectingRoad", "linkedRoad", "mainRoad") if tag == "road" else ("junction",)
    for element in root.iter():
        if element.tag == tag:
            yield element, "id"
        if element.get("elementType") == tag:
            yield element, "elementId"
        yield from ((element, name) for name in names if element.get(name) is not None)


def _complete_roads(_: Path, root: Element) -> Repairs:
    for road in root.iter("road"):
        if road.get("junction") is None:
            road.set("junction", "-1")
            yield f"road {road.get('id')}: taken as outside junctions, which it does not say"


def _unlink_lost_roads(_: Path, root: Element) -> Repairs:
    roads = {road.get("id") for road in root.iter("road")}
    for road in root.iter("road"):
        for links in road.iterfind("link"):
            for link in list(links):
                if link.get("elementType") == "road" and link.get("elementId") not in roads:
                    links.remove(link)
                    yield f"road {road.get('id')}: its link left out to road {link.get('elementId')}, which is lost"


def _simplify_shapes(path: Path, root: Element) -> Repairs:
    """Write arcs without curvature as lines, and spirals of one curvature as arcs: netconvert divides by zero."""
    for road in root.iter("road"):
        for plan in road.iterfind("planView"):
            pieces = list(plan.iterfind("geometry"))
            changed = [_simplify_shape(path, piece) for piece in pieces]
            empty = [piece for piece in pieces if read_number(path, piece, "length") == 0.0 and len(pieces) > 1]
            for piece in empty[: len(pieces) - 1]:
                plan.remove(piece)
            if any(changed):
                yield f"road {road.get('id')}: {sum(changed)} curves of constant curvature written as arcs or lines"
            if empty:
                yield f"road {road.get('id')}: {len(empty)} pieces without length left out"


def _simplify_shape(path: Path, piece: Element) -> bool:
    shape = piece.find("spiral")
    if shape is not None:
        first, last = (read_number(path, shape, name) for name in ("curvStart", "curvEnd"))
        if first != last:
            return False
        curvature = first
    elif (shape := piece.find("arc")) is not None:
        curvature = read_number(path, shape, "curvature")
        if curvature != 0.0:
            return False
    else:
        return False
    piece.remove(shape)
    ElementTree.SubElement(piece, "arc", {"curvature": repr(curvature)}) if curvature else ElementTree.SubElement(
        piece, "line"
    )
    return True


def _drop_words_for_no_limit(_: Path, root: Element) -> Repairs:
    count = 0
    for lane in root.iter("lane"):
        for speed in lane.findall("speed"):
            if speed.get("max", "").strip() in NO_LIMITS:
                lane.remove(speed)
                count += 1
    if count:
        yield f"{count} lanes without a speed limit get that of their road"


def _complete_signals(path: Path, root: Element) -> Repairs:
    for road in root.iter("road"):
        end = read_number(path, road, "length")
        for signals in road.iterfind("signals"):
            for signal in list(signals):
                if signal.tag in ("signal", "signalReference"):
                    yield from _complete_signal(signals, signal, end)
    signal_ids = {signal.get("id") for signal in root.iter("signal")}
    for signals in root.iter("signals"):
        for reference in signals.findall("signalReference"):
            if reference.get("id") not in signal_ids:
                signals.remove(reference)
                yield f"signal {reference.get('id')}: a reference to it left out, it is not in the map"


def _complete_signal(signals: Element, signal: Element, end: float) -> Repairs:
    """Leave out a signal without a place, bring one beyond its road back to it, complete its attributes."""
    id_ = signal.get("id")
    try:
        s, _ = (float(signal.get(name, "")) for name in ("s", "t"))
    except ValueError:
        signals.remove(signal)
        yield f"signal {id_}: left out, it has no place"
        return
    if not -ROUNDING_M <= s <= end + ROUNDING_M:
        signal.set("s", repr(min(max(s, 0.0), end)))
        yield f"signal {id_}: moved from s = {s:g} m to the nearer end of its road"
    if signal.get("orientation") is None:
        signal.set("orientation", "none")
        yield f"signal {id_}: taken as one of both directions, which it does not say"
    if signal.tag == "signal" and signal.get("dynamic") is None:
        signal.set("dynamic", "no")


def _drop_incomplete_connections(_: Path, root: Element) -> Repairs:
    """Leave out connections without a road in or within, as those of virtual junctions: side roads stay unconnected."""
    for junction in root.iter("junction"):
        lost = [
            connection
            for connection in junction.findall("connection")
            if connection.get("incomingRoad") is None or connection.get("connectingRoad") is None
        ]
        for connection in lost:
            junction.remove(connection)
        if lost:
            yield f"junction {junction.get('id')}: {len(lost)} connections left out that lack one of their roads"


def repair_road_links(root: Element) -> tuple[str, ...]:
    """Add missing back links to roads outside junctions, in place; return the changes."""
    roads = {road.get("id", ""): road for road in root.iter("road") if road.get("junction") == "-1"}
    return tuple(changed for id_, road in roads.items() for changed in _repair_road(id_, road, roads))


def _repair_road(id_: str, road: Element, roads: dict[str, Element]) -> Iterator[str]:
    for end, contact in CONTACTS.items():
        link = road.find(f"link/{end}")
        other_id = "" if link is None or link.get("elementType") != "road" else link.get("elementId", "")
        if link is None or other_id not in roads:
            continue
        answer = ENDS.get(link.get("contactPoint", ""), "predecessor")
        back = roads[other_id].find(f"link/{answer}")
        if back is not None and (back.get("elementType"), back.get("elementId")) == ("road", id_):
            continue
        _set_link(roads[other_id], answer, (id_, contact))
        _link_lanes_back(road, end, roads[other_id], answer)
        was = "nothing" if back is None else f"{back.get('elementType')} {back.get('elementId')}"
        yield f"road {other_id}: its {answer} is road {id_}, which says so, not {was}"


def _set_link(road: Element, end: str, to: tuple[str, str]) -> None:
    links = road.find("link")
    if links is None:
        links = ElementTree.SubElement(road, "link")
    for old in links.findall(end):
        links.remove(old)
    id_, contact = to
    ElementTree.SubElement(links, end, {"elementType": "road", "elementId": id_, "contactPoint": contact})


def _link_lanes_back(road: Element, end: str, other: Element, answer: str) -> None:
    """Link the lanes of `other` back to those of `road`, in the adjoining lane sections."""
    here, there = _list_lane_sections(road), _list_lane_sections(other)
    if not here or not there:
        return
    section, facing = here[0 if end == "predecessor" else -1], there[0 if answer == "predecessor" else -1]
    facing_lanes = {lane.get("id"): lane for lane in facing.iter("lane")}
    for lane in section.iter("lane"):
        link = lane.find(f"link/{end}")
        target = facing_lanes.get(link.get("id")) if link is not None else None
        if target is not None and target.find(f"link/{answer}") is None:
            links = target.find("link")
            if links is None:
                links = ElementTree.SubElement(target, "link")
            ElementTree.SubElement(links, answer, {"id": lane.get("id", "")})


def _list_lane_sections(road: Element) -> list[Element]:
    return list(road.iterfind("lanes/laneSection"))


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
    for tag, other, end in (
        ("predecessor", incoming, "end" if leaves_at_end else "start"),
        ("successor", linked, contact),
    ):
        attributes = {"elementType": "road", "elementId": other.get("id", ""), "contactPoint": end}
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


_STEPS: tuple[Callable[[Path, Element], Repairs], ...] = (
    _rename,
    _complete_roads,
    _link_back,
    _unlink_lost_roads,
    _simplify_shapes,
    _drop_words_for_no_limit,
    _complete_signals,
    replace_direct_junctions,
    _drop_incomplete_connections,
)
