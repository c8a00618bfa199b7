"""Tracks that drive on beside the lanes where the map's border cuts off their own lane.

Within reach of the next lane, the matcher follows it there: over a change at the very end of the lane, onto one on
which the vehicle never was. No vehicle can do that in the simulation. Where all frames on the other lanes are outside
their corridors, the track leaves the map (or comes onto it) at the border instead.
"""

from collections.abc import Sequence

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap


def find_route_on_map(
    roads: RoadMap, route: Sequence[str], lanes: Sequence[str], offset: Float
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the route without its ends beside the lanes, and the frames of those ends.

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
