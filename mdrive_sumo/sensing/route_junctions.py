"""The junctions on a route, with what tells their drivers who gives way."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from mdrive_sumo.contract import JunctionControl, JunctionKind
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import Lane, RoadMap

RING = "ring"
"""Stands for a roundabout."""


def find_junctions(lane_ids: Sequence[str], roads: RoadMap, route: Polyline) -> Iterator[JunctionControl]:
    """Yield the junctions on a route in their order; a roundabout is one junction from its ring's entry to its exit.

    lane_ids: of the route, in driving order. Junctions without a control are left out: there is no one to give way to.
    """
    lanes = [roads.lanes[lane_id] for lane_id in lane_ids]
    places = _find_places(lanes, roads)
    begin, s = 0, 0.0
    for _, group in groupby(places):
        end = begin + len(list(group))
        kind = _find_control(lanes[begin:end], roads)
        if kind is not None:
            entry = 0.0 if begin == 0 else _locate(route, lanes[begin - 1], s, at_end=True)
            s = route.length if end == len(lanes) else _locate(route, lanes[end], entry, at_end=False)
            yield JunctionControl(kind, entry, s)
        begin = end


def _find_places(lanes: Sequence[Lane], roads: RoadMap) -> list[str]:
    """Return the junction of each lane, `RING` for a roundabout with the ways into and out of it, "" for roads."""
    places: list[str] = []
    for lane in lanes:
        follows_ring = bool(places) and places[-1] == RING
        if lane.edge in roads.roundabout_edges or (lane.junction and (follows_ring or _enters_ring(lane, roads))):
            places.append(RING)
        else:
            places.append(lane.edge[1:].rpartition("_")[0] if lane.junction else "")
    return places


def _enters_ring(lane: Lane, roads: RoadMap) -> bool:
    return roads.junction_controls.get(lane.id) == "roundabout"


def _find_control(stretch: Sequence[Lane], roads: RoadMap) -> JunctionKind | None:
    """Return the control of a junction's first lane on the route; a route that begins in a ring is in a roundabout."""
    if stretch[0].edge in roads.roundabout_edges:
        return "roundabout"
    return next((kind for lane in stretch if (kind := roads.junction_controls.get(lane.id)) is not None), None)


def _locate(route: Polyline, lane: Lane, from_s: float, *, at_end: bool) -> float:
    """Return the arc length [m] along the route of an end of a lane, at or behind `from_s`."""
    return route.project(*lane.centre.at(lane.centre.length if at_end else 0.0), between=(from_s, route.length))[0]
