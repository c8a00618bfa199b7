"""The path of a track through the network, measured as SUMO measures it: one length for all lanes of an edge."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import Lane, RoadMap
from real2sim.match import LaneMatch
from real2sim.recording import RecordedTrack

JOINT_M = 0.1
"""[m] SUMO's length of a junction lane without extent; such lanes are in no RoadMap (`network.shapes`)."""
CLAMPED_M = 0.05
"""[m] A projection this near to an end of the path may belong to a position beyond it."""


@dataclass(frozen=True)
class RouteEdge:
    """One edge of a route: its lanes that are used, in order, and where it begins along the route [m]."""

    edge: str
    lanes: tuple[Lane, ...]
    begin: float
    length: float

    @property
    def junction(self) -> bool:
        """Whether the edge lies inside a junction."""
        return self.lanes[0].junction

    @property
    def end(self) -> float:
        """Where the edge ends along the route [m]."""
        return self.begin + self.length


@dataclass(frozen=True)
class RoutePath:
    """The edges of a route in order."""

    edges_in_order: tuple[RouteEdge, ...]

    @property
    def length(self) -> float:
        """[m]"""
        return self.edges_in_order[-1].end

    @property
    def edges(self) -> tuple[str, ...]:
        """Ids of the edges outside junctions, as in SUMO's routes."""
        return tuple(stage.edge for stage in self.edges_in_order if not stage.junction)

    @cached_property
    def _by_lane(self) -> dict[str, list[int]]:
        indices: dict[str, list[int]] = {}
        for i, stage in enumerate(self.edges_in_order):
            for lane in stage.lanes:
                if i not in indices.setdefault(lane.id, []):
                    indices[lane.id].append(i)
        return indices

    def find_edge_index(self, lane: str, least: int) -> int | None:
        """Return the index of the edge with that lane: the first from `least` on, else the last before; None if there
        is none."""
        indices = self._by_lane.get(lane, [])
        return next((i for i in indices if i >= least), indices[-1] if indices else None)


def build_route_path(roads: RoadMap, lanes: Sequence[str]) -> RoutePath:
    """Return the path along lanes that are successors or neighbours of one another."""
    groups: list[list[Lane]] = []
    joints = [0.0]
    for before, here in pairwise(["", *lanes]):
        lane = roads.lanes[here]
        if before and before == here:
            continue
        if before and here in (roads.lanes[before].left, roads.lanes[before].right):
            groups[-1].append(lane)
            continue
        if before:
            joints.append(0.0 if lane.junction or roads.lanes[before].junction else JOINT_M)
        groups.append([lane])
    stages: list[RouteEdge] = []
    for group, joint in zip(groups, joints, strict=True):
        begin = (stages[-1].end if stages else 0.0) + joint
        stages.append(RouteEdge(group[0].edge, tuple(group), begin, compute_edge_length(roads, group[0])))
    return RoutePath(tuple(stages))


def compute_edge_length(roads: RoadMap, lane: Lane) -> float:
    """Return SUMO's length [m] of the edge of a lane: the mean of its lanes (`network.shapes`); a junction lane has
    one."""
    if lane.junction:
        return lane.centre.length
    side, beside = lane, [lane]
    while side.left:
        side = roads.lanes[side.left]
        beside.append(side)
    side = lane
    while side.right:
        side = roads.lanes[side.right]
        beside.append(side)
    return float(np.mean([lane.centre.length for lane in beside]))


def compute_progress(path: RoutePath, track: RecordedTrack, match: LaneMatch) -> Float:
    """Return the distance (T,) [m] of the box centre along the path, monotonic; NaN before the first and after the last
    frame.

    Where no lane is known, or the position is before or behind the path, it is interpolated from the frames around it
    and the distance driven.
    """
    frames = np.flatnonzero(track.valid)
    whole = np.arange(frames[0], frames[-1] + 1)
    x, y = (np.interp(whole, frames, values[frames]) for values in (track.x, track.y))
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    indices, ahead = _find_matched_frames(path, match, whole)
    inside = (ahead > CLAMPED_M) & (ahead < path.length - CLAMPED_M)
    indices, ahead = (indices[inside], ahead[inside]) if inside.any() else (indices, ahead)
    along = np.full(len(match.lanes), np.nan)
    along[whole] = np.maximum.accumulate(driven + np.interp(whole, indices, ahead - driven[indices - frames[0]]))
    return along


def _find_matched_frames(path: RoutePath, match: LaneMatch, whole: np.ndarray) -> tuple[np.ndarray, Float]:
    """Return the frames with a lane of the path, and the distance along it there."""
    indices: list[int] = []
    ahead: list[float] = []
    stage = 0
    for frame in whole.tolist():
        index = path.find_edge_index(match.lanes[frame], stage) if match.lanes[frame] else None
        if index is None:
            continue
        stage = max(stage, index)
        here = path.edges_in_order[index]
        lane = next(candidate for candidate in here.lanes if candidate.id == match.lanes[frame])
        indices.append(frame)
        ahead.append(here.begin + float(match.s[frame]) * here.length / lane.centre.length)
    return np.array(indices, dtype=np.intp), np.array(ahead)


def find_straight_continuation(roads: RoadMap, lane: str, least_m: float) -> tuple[str, ...]:
    """Return the lanes after this one that turn least, until they are `least_m` long together or the network ends."""
    lanes: list[str] = []
    so_far = 0.0
    here = roads.lanes[lane]
    while (so_far < least_m or here.junction) and here.successors:
        here = roads.lanes[min(here.successors, key=lambda id_: (_compute_lane_turn(roads, id_), id_))]
        if here.id in lanes:
            break
        lanes.append(here.id)
        so_far += here.centre.length
    while lanes and roads.lanes[lanes[-1]].junction:
        lanes.pop()
    return tuple(lanes)


def _compute_lane_turn(roads: RoadMap, lane: str) -> float:
    yaws = roads.lanes[lane].centre.yaws
    return float(np.abs(np.diff(np.unwrap(yaws)).sum())) if len(yaws) > 1 else 0.0
