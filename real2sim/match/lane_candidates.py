"""Lanes of a network near many points, and distances between lanes along the network."""

import heapq
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from mdrive_sumo.core.geometry import Float, Int, wrap_angles
from mdrive_sumo.roads import Lane, RoadMap
from real2sim.polylines import PolylineIndex


@dataclass(frozen=True)
class LaneCandidates:
    """Pairs (P,) of a point and a lane near it, ordered by point."""

    point: Int
    lane: Int
    """Index into `RoadMap.driving`."""
    s: Float
    """Arc length [m] of the projection."""
    offset: Float
    """Signed lateral distance [m], positive to the left."""
    turn: Float
    """Angle [rad] from the lane to the given yaw; NaN where no yaw is known."""


@dataclass(frozen=True)
class LanePath:
    """Shortest path from the beginning of one lane to that of another."""

    length: float
    """[m]; parallel lanes count as equally long, so a lane change adds 0."""
    lane_changes: int
    lanes: tuple[str, ...]
    """Ids of the lanes from the first to the last."""


@dataclass(frozen=True, eq=False)
class LaneCandidateIndex:
    """A road map with its spatial index and a cache of the paths found so far."""

    roads: RoadMap
    lines: PolylineIndex
    changes_connectors: bool = False
    """Whether paths may change between connectors of a junction that part from one lane or join in one."""
    _paths: dict[tuple[str, float], dict[str, LanePath]] = field(
        default_factory=dict[tuple[str, float], dict[str, LanePath]]
    )

    def find_candidates(self, xy: Float, yaw: Float, reach: float) -> LaneCandidates:
        """Return lanes within `reach` [m] of points xy (N, 2) [m] with directions yaw (N,) [rad]."""
        feet = self.lines.project_points(xy, reach)
        side = np.where(feet.lateral <= 0, 1.0, -1.0)  # a line to the right means a point to its left
        return LaneCandidates(
            feet.point, feet.line, feet.s, side * feet.distance, wrap_angles(yaw[feet.point] - feet.yaw)
        )

    def find_paths(self, start: str, limit: float, change_m: float) -> dict[str, LanePath]:
        """Return paths from `start` to lanes that begin within about `limit` [m]; a lane change costs `change_m`."""
        rounded = 32.0 * 2.0 ** max(
            math.ceil(math.log2(max(limit, 1.0) / 32.0)), 0
        )  # few distinct limits make the cache effective
        if (start, rounded) not in self._paths:
            self._paths[start, rounded] = self._search(start, rounded, change_m)
        return self._paths[start, rounded]

    def _search(self, start: str, limit: float, change_m: float) -> dict[str, LanePath]:
        best: dict[str, LanePath] = {}
        queue: list[tuple[float, tuple[str, ...], float, int]] = [(0.0, (start,), 0.0, 0)]
        while queue:
            cost, path, length, changes = heapq.heappop(queue)
            here = path[-1]
            if here in best:
                continue
            best[here] = LanePath(length, changes, path)
            for there, step, is_change in self._list_next_lanes(self.roads.lanes[here]):
                if there not in best and length + step <= limit + self.roads.lanes[start].centre.length:
                    extra = change_m if is_change else step
                    heapq.heappush(queue, (cost + extra, (*path, there), length + step, changes + is_change))
        return best

    def _list_next_lanes(self, lane: Lane) -> Iterable[tuple[str, float, bool]]:
        """Yield lanes after or beside a lane, the distance [m] between their beginnings, and whether it is a change."""
        for successor in lane.successors:
            yield successor, lane.centre.length, False
        for neighbour in (lane.left, lane.right):
            if neighbour:
                yield neighbour, 0.0, True
        if self.changes_connectors:
            for other in self.connectors_from_same_lane[lane.id]:
                yield other, 0.0, True
            for other in self.connectors_to_same_lane[lane.id]:
                yield other, lane.centre.length - self.roads.lanes[other].centre.length, True

    @cached_property
    def connectors_from_same_lane(self) -> Mapping[str, tuple[str, ...]]:
        """The other junction lanes with a common predecessor, by junction lane."""
        return _group_siblings([lane.successors for lane in self.roads.driving], self.roads)

    @cached_property
    def connectors_to_same_lane(self) -> Mapping[str, tuple[str, ...]]:
        """The other junction lanes with a common successor, by junction lane."""
        before: dict[str, list[str]] = {}
        for lane in self.roads.driving:
            for id_ in lane.successors:
                before.setdefault(id_, []).append(lane.id)
        return _group_siblings(list(before.values()), self.roads)


def _group_siblings(groups: Sequence[Sequence[str]], roads: RoadMap) -> dict[str, tuple[str, ...]]:
    connectors: dict[str, set[str]] = {lane.id: set() for lane in roads.driving}
    for group in groups:
        inside = {id_ for id_ in group if roads.lanes[id_].junction}
        for id_ in inside:
            connectors[id_] |= inside - {id_}
    return {id_: tuple(sorted(others)) for id_, others in connectors.items()}


@lru_cache(maxsize=8)
def load_candidate_index(roads: RoadMap, changes_connectors: bool = False) -> LaneCandidateIndex:
    """Return the index of a network; cached because a RoadMap never changes."""
    return LaneCandidateIndex(roads, PolylineIndex([lane.centre for lane in roads.driving]), changes_connectors)
