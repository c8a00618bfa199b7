"""Repair the lanes of a match: changes between connectors, and ends beyond the border of the map."""

from collections.abc import Sequence

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from real2sim.match.lane_candidates import LaneCandidateIndex


def resolve_connector_changes(index: LaneCandidateIndex, lanes: Sequence[str]) -> list[str] | None:
    """Return a drivable sequence of lanes for one that changes between connectors of a junction; None if the lanes
    around a change do not lead through the connector that remains.

    At the entry of a junction lanes part, at its exit they join, and drivers move from one to another there: into a
    turning pocket at the last moment, around a stopped vehicle. SUMO and the routes of CAVs know no lane change inside
    junctions, so a route takes one connector: where lanes part the one that the driver took last, where they join the
    first.
    """
    route = list(lanes)
    i = 0
    while i + 1 < len(route):
        here = index.roads.lanes[route[i]]
        if route[i + 1] in (*here.successors, here.left, here.right):
            i += 1
        elif route[i + 1] in index.connectors_from_same_lane[here.id]:
            del route[i]
            i = max(i - 1, 0)
        elif route[i + 1] in index.connectors_to_same_lane[here.id]:
            del route[i + 1]
        else:
            return None
    return route


def find_route_on_map(
    roads: RoadMap, route: Sequence[str], lanes: Sequence[str], offset: Float
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the route without its ends beside the lanes, and the frames of those ends.

    Tracks drive on beside the lanes where the map's border cuts off their own lane. Within reach of the next lane, the
    matcher follows it there: over a change at the very end of the lane, onto one on which the vehicle never was. No
    vehicle can do that in the simulation. Where all frames on the other lanes are outside their corridors, the track
    leaves the map (or comes onto it) at the border instead.

    `lanes`, `offset` [m]: lane of each frame and lateral distance to it.
    """
    kept, frames = tuple(route), tuple[int, ...]()
    has_predecessor = {successor for lane in roads.driving for successor in lane.successors}
    for i, lane in enumerate(kept[:-1]):
        if not roads.lanes[lane].successors and (
            out := _find_outside(roads, kept[i + 1 :], kept[: i + 1], lanes, offset)
        ):
            kept, frames = kept[: i + 1], out
            break
    for i in range(len(kept) - 1, 0, -1):
        if kept[i] not in has_predecessor and (out := _find_outside(roads, kept[:i], kept[i:], lanes, offset)):
            return kept[i:], (*out, *frames)
    return kept, frames


def _find_outside(
    roads: RoadMap, end: Sequence[str], rest: Sequence[str], lanes: Sequence[str], offset: Float
) -> tuple[int, ...]:
    """Return the frames on the lanes of one end of a route, if all are outside their corridors; else ()."""
    frames = [k for k, lane in enumerate(lanes) if lane in end and lane not in rest]
    is_outside = all(abs(float(offset[k])) > roads.lanes[lanes[k]].width / 2 for k in frames)
    return tuple(frames) if is_outside else ()
