"""Who gives way where: what the signs, lights and rules of a junction tell the driver of each approach."""

# pyright: basic
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import shapely

from mdrive_sumo.contract.briefing import JunctionKind

RULE_BY_TYPE: Mapping[str, JunctionKind] = {
    "allway_stop": "all-way-stop",
    "right_before_left": "right-before-left",
    "left_before_right": "left-before-right",
    "unregulated": "uncontrolled",
}
"""SUMO's types of nodes whose rule is the same for all approaches."""
PRIORITY, STOP, ZIPPER = "M", "s", "Z"
"""States of connections in a net: those that others give way to, those behind a stop sign, lanes that merge in turn."""


def find_junction_controls(
    net: Any, cars: Collection[str], signed: Collection[str] | None
) -> Mapping[str, JunctionKind]:
    """Return what controls the way into a junction, by id of the first lane inside it.

    net: of sumolib, with connections and foes. cars: ids of lanes that cars may use. signed: ids of lanes with a stop
    sign; None: unknown, so that the net says which approaches stop. Junctions at which the ways of cars neither cross
    nor merge have none.
    """
    rings = find_roundabout_edges(net)
    return {via: kind for node in net.getNodes() for via, kind in _find_node_controls(net, node, cars, signed, rings)}


def find_roundabout_edges(net: Any) -> frozenset[str]:
    """Return the ids of the edges of roundabouts."""
    return frozenset(edge for ring in net.getRoundabouts() for edge in ring.getEdges())


def _find_node_controls(
    net: Any, node: Any, cars: Collection[str], signed: Collection[str] | None, rings: Collection[str]
) -> Iterator[tuple[str, JunctionKind]]:
    conflicts = _count_conflicts(net, node, cars)
    for edge in node.getIncoming():
        yield from _find_controls(node, edge, conflicts, cars, signed, rings)


def _find_controls(
    node: Any,
    edge: Any,
    conflicts: Mapping[str, int],
    cars: Collection[str],
    signed: Collection[str] | None,
    rings: Collection[str],
) -> Iterator[tuple[str, JunctionKind]]:
    """Yield the ways from an approach into a junction with their control."""
    ways = [way for lane in edge.getLanes() for way in lane.getOutgoing() if way.getViaLaneID() in cars]
    rule = _find_rule(node, [way for way in ways if conflicts.get(way.getViaLaneID()) or way.getState() == ZIPPER])
    if signed is not None and rule in ("stop", "yield", "priority-road"):
        has_sign = any(lane.getID() in signed for lane in edge.getLanes())
        rule = "stop" if has_sign else "yield" if rule == "stop" else rule
    for way in ways:
        if way.getTLSID():
            yield way.getViaLaneID(), "traffic-light"
        elif edge.getID() not in rings and way.getTo().getID() in rings:
            yield way.getViaLaneID(), "roundabout"
        elif rule is not None:
            yield way.getViaLaneID(), rule


def _find_rule(node: Any, ways: Sequence[Any]) -> JunctionKind | None:
    """Return the rule of an approach from its ways that others cross or join; None if there are none.

    The left turn from a main road gives way to those who come towards it: its driver still sees the priority road.
    """
    if not ways:
        return None
    states = {way.getState() for way in ways}
    if node.getType() in RULE_BY_TYPE:
        return RULE_BY_TYPE[node.getType()]
    if ZIPPER in states or node.getType() == "zipper":
        return "zipper"
    if PRIORITY in states:
        return "priority-road"
    return "stop" if STOP in states else "yield"


def _count_conflicts(net: Any, node: Any, cars: Collection[str]) -> Mapping[str, int]:
    """Return how many ways from other approaches cross or join each way, by id of its first lane in the junction."""
    is_regulated = node.getType() != "unregulated"  # of others the net lists no conflicts
    if is_regulated and not node.hasFoes():
        return {}
    ways = [(way, index) for way, index in _list_links(net, node) if way.getViaLaneID() in cars]
    return {
        way.getViaLaneID(): sum(
            there.getFrom() is not way.getFrom()
            and (node.areFoes(index, other) if is_regulated else _touch(way, there))
            for there, other in ways
        )
        for way, index in ways
    }


def _list_links(net: Any, node: Any) -> Iterator[tuple[Any, int]]:
    """Yield the ways through a junction with their index in its table of conflicts.

    As sumolib's `getLinkIndex`, which counts from the start for each way: in large junctions that takes half of the
    time to load a network.
    """
    index = 0
    for lane in filter(None, node._incLanes):  # sumolib has no other access to their order
        for way in net.getLane(lane).getOutgoing():
            here, there = (end.getEdge().getFunction() for end in (way.getFromLane(), way.getToLane()))
            if there != "walkingarea" and (here != "walkingarea" or there == "crossing"):
                yield way, index
                index += 1


def _touch(one: Any, other: Any) -> bool:
    """Return whether two ways end on one lane, or cross."""
    if one.getToLane() is other.getToLane():
        return True
    lines = [
        shapely.LineString([way.getFromLane().getShape()[-1][:2], way.getToLane().getShape()[0][:2]])
        for way in (one, other)
    ]
    return bool(lines[0].crosses(lines[1]))
