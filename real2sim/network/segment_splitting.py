"""Split segments where neighbours begin or end and around crossings, then group adjacent ones."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence

from real2sim.network.lane_adjacency import LaneAdjacency, find_adjacencies, find_crossings
from real2sim.network.lane_segment import LaneLink, LaneSegment, split_segments

MARGIN_M = 8.0
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


def split_at_neighbours(strips: Mapping[str, LaneSegment], links: Iterable[LaneLink]) -> SplitSegments:
    """Split segments so that they begin and end where their neighbours do."""
    pieces, joined = split_segments(strips, links, _find_crossing_cuts(strips))
    for _ in range(ROUNDS):
        stations = _find_adjacency_cuts(pieces, _find_crossing_ids(pieces))
        if not stations:
            break
        pieces, joined = split_segments(pieces, joined, stations)
    return pieces, joined


def _find_crossing_ids(strips: Mapping[str, LaneSegment]) -> set[str]:
    return {id_ for pair in find_crossings(strips) for id_ in pair}


def _find_crossing_cuts(strips: Mapping[str, LaneSegment]) -> dict[str, list[float]]:
    wanted: dict[str, list[float]] = defaultdict(list)
    for pair, places in find_crossings(strips).items():
        for k, id_ in enumerate(pair):
            at = [place[k] for place in places]
            if not strips[id_].junction:
                wanted[id_] += [min(at) - CROSSING_HALF_M, max(at) + CROSSING_HALF_M]
    return _space_out_cuts(strips, {id_: _merge_stretches(stations) for id_, stations in wanted.items()})


def _merge_stretches(stations: Sequence[float]) -> list[float]:
    """Merge overlapping stretches (begin, end, begin, end...) and return the bounds of their unions."""
    bounds: list[float] = []
    for begin, end in sorted(zip(stations[::2], stations[1::2], strict=True)):
        if bounds and begin <= bounds[-1] + MARGIN_M:
            bounds[-1] = max(bounds[-1], end)
        else:
            bounds += [begin, end]
    return bounds


def _find_adjacency_cuts(strips: Mapping[str, LaneSegment], connectors: Collection[str]) -> dict[str, list[float]]:
    wanted: dict[str, list[float]] = defaultdict(list)
    for beside in find_adjacencies({id_: s for id_, s in strips.items() if not s.junction and id_ not in connectors}):
        strip, other = strips[beside.segment], strips[beside.other]
        for station, point in ((beside.begin, other.start), (beside.end, other.end)):
            foot = strip.centreline.project(float(point[0]), float(point[1]))[0]
            if abs(foot - station) < SAME_CUT_M:
                wanted[strip.id].append(foot)
    return _space_out_cuts(strips, wanted)


def _space_out_cuts(strips: Mapping[str, LaneSegment], wanted: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    tidy: dict[str, list[float]] = {}
    for id_, stations in wanted.items():
        kept: list[float] = []
        for station in sorted(stations):
            inside = MARGIN_M <= station <= strips[id_].centreline.length - MARGIN_M
            if inside and (not kept or station - kept[-1] >= MARGIN_M):
                kept.append(station)
        if kept:
            tidy[id_] = kept
    return tidy


def group_adjacent_segments(strips: Mapping[str, LaneSegment]) -> list[tuple[str, ...]]:
    """Return ids of segments that are adjacent from beginning to end, right to left; each segment is in one group."""
    left = _find_mutual_left([b for b in find_adjacencies(strips) if _is_aligned(strips, b)])
    right = {there: here for here, there in left.items()}
    groups: list[tuple[str, ...]] = []
    for id_ in strips:
        if id_ not in right:
            chain = [id_]
            while chain[-1] in left:
                chain.append(left[chain[-1]])
            groups.append(tuple(chain))
    return groups


def _is_aligned(strips: Mapping[str, LaneSegment], beside: LaneAdjacency) -> bool:
    strip, other = strips[beside.segment], strips[beside.other]
    long = strip.centreline.length
    apart = (
        other.centreline.project(*strip.centreline.at(0.0))[0],
        other.centreline.length - other.centreline.project(*strip.centreline.at(long))[0],
    )
    return max(beside.begin, long - beside.end, *apart) <= ALIGNED_M


def _find_mutual_left(besides: Sequence[LaneAdjacency]) -> dict[str, str]:
    """Return the left neighbour of every segment where both are mutually nearest."""
    nearest: dict[tuple[str, bool], LaneAdjacency] = {}
    for beside in besides:
        key = (beside.segment, beside.offset > 0)
        if key not in nearest or abs(beside.offset) < abs(nearest[key].offset):
            nearest[key] = beside
    return {
        strip: beside.other
        for (strip, to_left), beside in nearest.items()
        if to_left and (beside.other, False) in nearest and nearest[beside.other, False].other == strip
    }
