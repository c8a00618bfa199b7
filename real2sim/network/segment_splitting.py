"""Split segments where neighbours begin or end and around crossings, then group adjacent ones."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence

from real2sim.network.lane_adjacency import LaneAdjacency, find_adjacencies, find_crossings
from real2sim.network.lane_segment import LaneLink, LaneSegment, split_segments

MIN_PART_M = 8.0
"""[m] Minimum length of a part."""
SAME_CUT_M = 5.0
"""[m] Cuts closer to each other are merged."""
CROSSING_HALF_M = 20.0
"""[m] A lane drawn through a crossing becomes a connector over this distance on both sides."""
ALIGNED_M = 6.0
"""[m] Neighbours belong to one edge if they begin and end within this distance along the lane."""
ROUNDS = 3
"""Cuts propagate from neighbour to neighbour: at most as often as a wide road has lanes."""

SplitSegments = tuple[dict[str, LaneSegment], set[LaneLink]]


def split_at_neighbours(segments: Mapping[str, LaneSegment], links: Iterable[LaneLink]) -> SplitSegments:
    """Split segments so that they begin and end where their neighbours do."""
    parts, joined = split_segments(segments, links, _find_crossing_cuts(segments))
    for _ in range(ROUNDS):
        stations = _find_adjacency_cuts(parts, {id_ for pair in find_crossings(parts) for id_ in pair})
        if not stations:
            break
        parts, joined = split_segments(parts, joined, stations)
    return parts, joined


def _find_crossing_cuts(segments: Mapping[str, LaneSegment]) -> dict[str, list[float]]:
    wanted: dict[str, list[float]] = defaultdict(list)
    for pair, places in find_crossings(segments).items():
        for k, id_ in enumerate(pair):
            places_here = [place[k] for place in places]
            if not segments[id_].junction:
                wanted[id_] += [min(places_here) - CROSSING_HALF_M, max(places_here) + CROSSING_HALF_M]
    return _space_out_cuts(segments, {id_: _merge_stretches(stations) for id_, stations in wanted.items()})


def _merge_stretches(stations: Sequence[float]) -> list[float]:
    """Merge overlapping stretches (begin, end, begin, end...) and return the bounds of their unions."""
    bounds: list[float] = []
    for begin, end in sorted(zip(stations[::2], stations[1::2], strict=True)):
        if bounds and begin <= bounds[-1] + MIN_PART_M:
            bounds[-1] = max(bounds[-1], end)
        else:
            bounds += [begin, end]
    return bounds


def _find_adjacency_cuts(segments: Mapping[str, LaneSegment], connectors: Collection[str]) -> dict[str, list[float]]:
    wanted: dict[str, list[float]] = defaultdict(list)
    for adjacency in find_adjacencies(
        {id_: s for id_, s in segments.items() if not s.junction and id_ not in connectors}
    ):
        segment, other = segments[adjacency.segment], segments[adjacency.other]
        for station, point in ((adjacency.begin, other.start), (adjacency.end, other.end)):
            foot = segment.centreline.project(float(point[0]), float(point[1]))[0]
            if abs(foot - station) < SAME_CUT_M:
                wanted[segment.id].append(foot)
    return _space_out_cuts(segments, wanted)


def _space_out_cuts(
    segments: Mapping[str, LaneSegment], wanted: Mapping[str, Sequence[float]]
) -> dict[str, list[float]]:
    tidy: dict[str, list[float]] = {}
    for id_, stations in wanted.items():
        kept: list[float] = []
        for station in sorted(stations):
            inside = MIN_PART_M <= station <= segments[id_].centreline.length - MIN_PART_M
            if inside and (not kept or station - kept[-1] >= MIN_PART_M):
                kept.append(station)
        if kept:
            tidy[id_] = kept
    return tidy


def group_adjacent_segments(segments: Mapping[str, LaneSegment]) -> list[tuple[str, ...]]:
    """Return ids of segments that are adjacent from beginning to end, right to left; each segment is in one group."""
    left = _find_mutual_left([b for b in find_adjacencies(segments) if _is_aligned(segments, b)])
    right = {there: here for here, there in left.items()}
    groups: list[tuple[str, ...]] = []
    for id_ in segments:
        if id_ not in right:
            chain = [id_]
            while chain[-1] in left:
                chain.append(left[chain[-1]])
            groups.append(tuple(chain))
    return groups


def _is_aligned(segments: Mapping[str, LaneSegment], adjacency: LaneAdjacency) -> bool:
    segment, other = segments[adjacency.segment], segments[adjacency.other]
    long = segment.centreline.length
    apart = (
        other.centreline.project(*segment.centreline.at(0.0))[0],
        other.centreline.length - other.centreline.project(*segment.centreline.at(long))[0],
    )
    return max(adjacency.begin, long - adjacency.end, *apart) <= ALIGNED_M


def _find_mutual_left(adjacencies: Sequence[LaneAdjacency]) -> dict[str, str]:
    """Return the left neighbour of every segment where both are mutually nearest."""
    nearest: dict[tuple[str, bool], LaneAdjacency] = {}
    for adjacency in adjacencies:
        key = (adjacency.segment, adjacency.offset > 0)
        if key not in nearest or abs(adjacency.offset) < abs(nearest[key].offset):
            nearest[key] = adjacency
    return {
        segment: adjacency.other
        for (segment, to_left), adjacency in nearest.items()
        if to_left and (adjacency.other, False) in nearest and nearest[adjacency.other, False].other == segment
    }
