"""Plan a network: segments become lanes of edges or connections through junctions, their ends become nodes."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Polyline, build_polyline
from real2sim.network.lane_adjacency import find_crossings
from real2sim.network.lane_segment import LaneLink, LaneSegment, split_segments
from real2sim.network.segment_splitting import group_adjacent_segments
from real2sim.network.stub_edges import add_stubs, find_contraflow_ends

FOLD_M = 40.0
"""[m] Edges up to this length that return to the same junction are part of it."""
MAX_PATHS = 64
"""Maximum number of paths from one lane through one junction; only broken maps have more."""

SegmentEnd = tuple[str, int]
"""Beginning (0) or end (1) of a segment."""


@dataclass(frozen=True)
class PlannedEdge:
    """Adjacent lanes from right to left, between two nodes."""

    lanes: tuple[LaneSegment, ...]
    begin: int
    end: int


@dataclass(frozen=True)
class PlannedConnection:
    """Connection between lanes of two edges; `shape` is its path inside the junction, None if they touch."""

    start: str
    goal: str
    shape: Polyline | None
    speed: float
    connectors: tuple[str, ...]
    """Segments inside the junction that it runs through."""


@dataclass(frozen=True)
class NetworkPlan:
    """Edges and connections; nodes are numbers."""

    edges: tuple[PlannedEdge, ...]
    connections: tuple[PlannedConnection, ...]
    unused: tuple[LaneSegment, ...]
    """Connectors without any connection."""
    contraflow: tuple[str, ...] = ()
    """Segments that are left out: their open end lies on a lane of the opposite direction."""


class _DisjointSets:
    """Disjoint sets of segment ends."""

    def __init__(self) -> None:
        self._parent: dict[SegmentEnd, SegmentEnd] = {}

    def find(self, port: SegmentEnd) -> SegmentEnd:
        root = port
        while (above := self._parent.get(root, root)) != root:
            root = above
        while (above := self._parent.get(port, port)) != root:
            self._parent[port] = root
            port = above
        return root

    def join(self, first: SegmentEnd, second: SegmentEnd) -> None:
        self._parent[self.find(first)] = self.find(second)


def plan_network(
    segments: Mapping[str, LaneSegment], links: Iterable[LaneLink], driven: Collection[str] = ()
) -> NetworkPlan:
    """Decide which segments are edges, which are connectors inside junctions, and which ends share a node.

    `driven`: lanes of the source on which the log shows traffic; they are never left out.
    """
    kept, ways, contraflow = _leave_out_contraflow(segments, set(links), driven)
    parts, joined = add_stubs(kept, ways, _find_connectors(kept, ways))
    inside = _find_connectors(parts, joined)
    groups = group_adjacent_segments({id_: part for id_, part in parts.items() if id_ not in inside})
    sets = _join_ends(parts, joined, inside, groups)
    folded = _find_inner_edges(parts, joined, groups, sets)
    inside |= folded
    groups = [group for group in groups if group[0] not in folded]
    loops = {id_ for group in groups if _is_loop(sets, group) for id_ in group}
    if loops:
        parts, joined = split_segments(parts, joined, {id_: [parts[id_].centreline.length / 2] for id_ in loops})
        groups = [half for group in groups for half in _split_group(group, loops)]
        sets = _join_ends(parts, joined, inside, groups)
    connections = _build_connections(parts, joined, inside)
    used = {id_ for connection in connections for id_ in connection.connectors}
    return NetworkPlan(
        _build_edges(parts, groups, sets),
        tuple(connections),
        tuple(parts[id_] for id_ in sorted(inside - used)),
        contraflow,
    )


def _leave_out_contraflow(
    segments: Mapping[str, LaneSegment], links: set[LaneLink], driven: Collection[str]
) -> tuple[dict[str, LaneSegment], set[LaneLink], tuple[str, ...]]:
    """Leave out segments that end on lanes of the opposite direction, until none is left; also return their ids."""
    kept, left_out = dict(segments), list[str]()
    while gone := find_contraflow_ends(kept, links, _find_connectors(kept, links), driven):
        kept = {id_: segment for id_, segment in kept.items() if id_ not in gone}
        links = {(a, b) for a, b in links if a not in gone and b not in gone}
        left_out += sorted(gone)
    return kept, links, tuple(left_out)


def _split_group(group: tuple[str, ...], loops: Collection[str]) -> Iterable[tuple[str, ...]]:
    if group[0] not in loops:
        return (group,)
    return (tuple(f"{id_}~{k}" for id_ in group) for k in (0, 1))


def _find_connectors(segments: Mapping[str, LaneSegment], links: Collection[LaneLink]) -> set[str]:
    """Return segments that cross others, and junction segments that branch or merge."""
    ahead, behind = _index_links(links)
    inside = {id_ for pair in find_crossings(segments) for id_ in pair}
    for id_, segment in segments.items():
        siblings = any(len(ahead[b]) > 1 for b in behind[id_]) or any(len(behind[a]) > 1 for a in ahead[id_])
        if segment.junction and siblings:
            inside.add(id_)
    return inside


def _index_links(links: Iterable[LaneLink]) -> tuple[defaultdict[str, list[str]], defaultdict[str, list[str]]]:
    ahead: defaultdict[str, list[str]] = defaultdict(list)
    behind: defaultdict[str, list[str]] = defaultdict(list)
    for a, b in sorted(links):
        ahead[a].append(b)
        behind[b].append(a)
    return ahead, behind


def _join_ends(
    segments: Mapping[str, LaneSegment],
    links: Iterable[LaneLink],
    inside: Collection[str],
    groups: Sequence[tuple[str, ...]],
) -> _DisjointSets:
    sets = _DisjointSets()
    for a, b in sorted(links):
        sets.join((a, 1), (b, 0))
    for id_ in sorted(inside):
        sets.join((id_, 0), (id_, 1))
    for first, second in sorted(find_crossings({id_: segments[id_] for id_ in inside})):
        sets.join((first, 0), (second, 0))
    for group in groups:
        for id_ in group[1:]:
            sets.join((group[0], 0), (id_, 0))
            sets.join((group[0], 1), (id_, 1))
    return sets


def _is_loop(sets: _DisjointSets, group: tuple[str, ...]) -> bool:
    return sets.find((group[0], 0)) == sets.find((group[0], 1))


def _find_inner_edges(
    segments: Mapping[str, LaneSegment],
    links: Iterable[LaneLink],
    groups: Sequence[tuple[str, ...]],
    sets: _DisjointSets,
) -> set[str]:
    """Return short edges inside one junction whose lanes all have predecessors and successors."""
    ahead, behind = _index_links(links)
    return {
        id_
        for group in groups
        if _is_loop(sets, group)
        and all(
            segments[lane_id].centreline.length <= FOLD_M and ahead[lane_id] and behind[lane_id] for lane_id in group
        )
        for id_ in group
    }


def _build_edges(
    segments: Mapping[str, LaneSegment], groups: Sequence[tuple[str, ...]], sets: _DisjointSets
) -> tuple[PlannedEdge, ...]:
    numbers: dict[SegmentEnd, int] = {}
    edges: list[PlannedEdge] = []
    for group in groups:
        begin, end = (numbers.setdefault(sets.find((group[0], side)), len(numbers)) for side in (0, 1))
        edges.append(PlannedEdge(tuple(segments[id_] for id_ in group), begin, end))
    return tuple(edges)


def _build_connections(
    segments: Mapping[str, LaneSegment], links: Iterable[LaneLink], inside: Collection[str]
) -> list[PlannedConnection]:
    ahead, _ = _index_links(links)
    connections: dict[LaneLink, PlannedConnection] = {}
    for start in (id_ for id_ in segments if id_ not in inside):
        for path in _find_paths(start, ahead, inside):
            connection = _build_connection(segments, start, path)
            key = (connection.start, connection.goal)
            if key not in connections or _measure_length(connection) < _measure_length(connections[key]):
                connections[key] = connection
    return list(connections.values())


def _measure_length(connection: PlannedConnection) -> float:
    return 0.0 if connection.shape is None else connection.shape.length


def _find_paths(start: str, ahead: Mapping[str, Sequence[str]], inside: Collection[str]) -> list[tuple[str, ...]]:
    """Return chains of connectors from a lane to the next lane of an edge, which is the last element."""
    paths: list[tuple[str, ...]] = []
    open_: list[tuple[str, ...]] = [(next_,) for next_ in reversed(ahead.get(start, ()))]
    while open_ and len(paths) < MAX_PATHS:
        path = open_.pop()
        if path[-1] not in inside:
            paths.append(path)
        else:
            open_ += [(*path, next_) for next_ in reversed(ahead.get(path[-1], ())) if next_ not in path]
    return paths


def _build_connection(segments: Mapping[str, LaneSegment], start: str, path: tuple[str, ...]) -> PlannedConnection:
    first, last = segments[start], segments[path[-1]]
    through = [segments[id_] for id_ in path[:-1]]
    points = np.concatenate([[first.end], *(segment.centreline.xy for segment in through), [last.start]])
    apart = float(np.hypot(*np.diff(points, axis=0).T).sum())
    line = build_polyline(_drop_close_points(points)) if apart > 0.1 else None
    return PlannedConnection(start, path[-1], line, min(s.speed for s in (*through, last)), tuple(path[:-1]))


def _drop_close_points(points: np.ndarray) -> np.ndarray:
    """Drop points closer than 5 cm to the previous one, except the last."""
    keep = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[keep[-1]])) > 0.05:
            keep.append(i)
        elif i == len(points) - 1 and len(keep) > 1:
            keep[-1] = i
    return points[keep]
