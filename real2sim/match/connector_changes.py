"""Resolve changes between connectors of one junction, which drivers make and networks lack.

At the entry of a junction lanes part, at its exit they join, and drivers move from one to another there: into a turning
pocket at the last moment, around a stopped vehicle. SUMO and the routes of CAVs know no lane change inside junctions,
so a route takes one connector: where lanes part the one that the driver took last, where they join the first.
"""

from collections.abc import Sequence

from real2sim.match.lane_candidates import LaneCandidateIndex


def resolve_connector_changes(index: LaneCandidateIndex, lanes: Sequence[str]) -> list[str] | None:
    """Return a drivable sequence of lanes for one that changes between connectors; None if the lanes around a change
    do not lead through the connector that remains."""
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
