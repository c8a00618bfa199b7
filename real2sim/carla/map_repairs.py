"""Repair OpenDRIVE maps of which netconvert refuses a detail that does not change where the lanes lie."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from real2sim.carla.direct_junctions import replace_direct_junctions
from real2sim.carla.road_links import repair_road_links
from real2sim.xml_file import Element, read_number

ROUNDING_M = 0.01
"""[m] Signals at the end of a road lie behind it by the last digits of their place."""
NO_LIMITS = ("no limit", "undefined")
"""Words that the standard allows for a speed. netconvert reads them for a road, not for a lane."""
FORBIDDEN = re.compile(r"""[\s|\\'";,<>&!:*?/]""")
"""Characters that ids in SUMO must not have, and the separators that it uses for some of them."""
Repairs = Iterator[str]


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
    known = {signal.get("id") for signal in root.iter("signal")}
    for signals in root.iter("signals"):
        for reference in signals.findall("signalReference"):
            if reference.get("id") not in known:
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
