"""Stub edges where the map's border cuts off connectors, without stubs that lie on other lanes.

A connector without predecessor or successor gets a short edge at its open end. Two classes of such edges would overlap
other lanes, and a vehicle there would be on either of them:
- The connector ends inside the junction on a lane of the opposite direction (maps converted from OpenStreetMap lead a
  left-turn lane straight on into the oncoming one). Such a connector leads nowhere and is left out.
- Several connectors begin or end at one point of the map's border. They share one stub.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import shapely

from real2sim.network.lane_segment import LaneLink, LaneSegment, compute_yaw_difference, split_segments
from real2sim.polylines import PolylineIndex, compute_angles_between

STUB_M = 2.0
"""[m] Length of the edge added where the map's border cuts off a connector."""
SHORT_M = 20.0
"""[m] A lane up to this length that leads nowhere is treated like a stub: about the way across a junction."""
ON_LANE_M = 1.5
"""[m] A stub this near to a centre line lies on that lane: half of a narrow lane."""
OPPOSITE_RAD = float(np.radians(120.0))
"""The scorer's angle for a wrong lane after a junction (protocol 7.3)."""
SAME_POINT_M = 0.3
SAME_RAD = float(np.radians(20.0))
"""Open ends this close and aligned begin or end on the same lane beyond the border."""
SAMPLES, SPACING_M = 3, 2.0
"""Least number of points at which a stub is compared with other lanes, and their largest distance [m]."""

SegmentsAndLinks = tuple[dict[str, LaneSegment], set[LaneLink]]


def compute_stub_length(segment: LaneSegment) -> float:
    """Return the length [m] of the stub at an open end of a connector."""
    return min(STUB_M, segment.centreline.length / 4)


def find_contraflow_ends(
    segments: Mapping[str, LaneSegment], links: Collection[LaneLink], inside: Collection[str], driven: Collection[str]
) -> set[str]:
    """Return connectors (`inside`) and short lanes with an open end that lies on a lane of the opposite direction.

    Lanes on which the log shows traffic (`driven`, ids of the source) are kept.
    """
    behind, ahead = {b for _, b in links}, {a for a, _ in links}
    lines = PolylineIndex([segment.centreline for segment in segments.values()])
    ids = list(segments)
    contraflow: set[str] = set()
    for id_, segment in segments.items():
        is_open = id_ not in behind, id_ not in ahead
        is_short = segment.centreline.length <= SHORT_M
        if not any(is_open) or all(is_open) or segment.source_lane in driven or (id_ not in inside and not is_short):
            continue
        length = segment.centreline.length
        stub = compute_stub_length(segment) if id_ in inside else length
        begin = 0.0 if is_open[0] else length - stub
        if _is_on_opposite_lanes(lines, ids.index(id_), (begin, begin + stub)):
            contraflow.add(id_)
    return contraflow


def _is_on_opposite_lanes(lines: PolylineIndex, own: int, part: tuple[float, float]) -> bool:
    """Return whether other segments run against the part (from, to [m]) of a segment at all of its samples."""
    line = lines.polylines[own]
    count = max(SAMPLES, round((part[1] - part[0]) / SPACING_M) + 1)
    stations = part[0] + (part[1] - part[0]) * (np.arange(count) + 0.5) / count
    feet = lines.project_points(np.array([line.at(float(s)) for s in stations]), ON_LANE_M)
    turn = compute_angles_between(feet.yaw, line.yaws_at(stations)[feet.point])
    against = (turn >= OPPOSITE_RAD) & (np.abs(feet.longitudinal) < ON_LANE_M / 3) & (feet.line != own)
    return len(np.unique(feet.point[against])) == count


def add_stubs(segments: Mapping[str, LaneSegment], links: set[LaneLink], inside: Collection[str]) -> SegmentsAndLinks:
    """Cut a stub off every open end of the connectors; connectors with the same open end share one stub."""
    behind, ahead = {b for _, b in links}, {a for a, _ in links}
    begins = [id_ for id_ in segments if id_ in inside and id_ not in behind]
    ends = [id_ for id_ in segments if id_ in inside and id_ not in ahead]
    stations: dict[str, list[float]] = {}
    for id_ in begins:
        stations.setdefault(id_, []).append(compute_stub_length(segments[id_]))
    for id_ in ends:
        length = segments[id_].centreline.length
        stations.setdefault(id_, []).append(length - compute_stub_length(segments[id_]))
    parts, joined = split_segments(segments, links, stations)
    for owner, others in _group_by_end(segments, begins, at_start=True):
        _replace_stubs(parts, joined, f"{owner}~0", [f"{other}~0" for other in others])
    for owner, others in _group_by_end(segments, ends, at_start=False):
        last = [f"{id_}~{len(stations[id_])}" for id_ in (owner, *others)]
        _replace_stubs(parts, joined, last[0], last[1:])
    return parts, joined


def _group_by_end(
    segments: Mapping[str, LaneSegment], ids: Sequence[str], at_start: bool
) -> Iterable[tuple[str, list[str]]]:
    """Yield the first segment of each group that shares an open end, and the others."""
    if len(ids) < 2:
        return
    points = np.array([segments[id_].start if at_start else segments[id_].end for id_ in ids])
    geometries: Any = shapely.points(points)
    near = shapely.STRtree(geometries).query(geometries, predicate="dwithin", distance=SAME_POINT_M)
    taken: set[int] = set()
    for i in range(len(ids)):
        if i in taken:
            continue
        beside = [int(j) for j in near[1][near[0] == i] if j > i and int(j) not in taken]
        same = sorted(j for j in beside if _is_aligned(segments[ids[i]], segments[ids[j]], at_start))
        taken.update(same)
        if same:
            yield ids[i], [ids[j] for j in same]


def _is_aligned(first: LaneSegment, second: LaneSegment, at_start: bool) -> bool:
    yaws = (first.start_yaw, second.start_yaw) if at_start else (first.end_yaw, second.end_yaw)
    return compute_yaw_difference(*yaws) <= SAME_RAD


def _replace_stubs(parts: dict[str, LaneSegment], links: set[LaneLink], stub: str, others: Sequence[str]) -> None:
    """Remove the other stubs; what they are linked with is linked with `stub`."""
    for other in others:
        del parts[other]
        for a, b in [link for link in links if other in link]:
            links.discard((a, b))
            links.add((stub if a == other else a, stub if b == other else b))
