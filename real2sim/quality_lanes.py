"""Where trajectories lie on the lanes of a map: lateral offset, off-route and wrong-way frames, illegal lane jumps."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.geometry import Bool, Float, Int, wrap_angles
from real2sim.hdmap import HdMap, LaneKind

SAME_LANE_M = 1.75
"""Lanes this near are as good as the nearest: within a junction lanes of all directions overlap."""
ALMOST_M = 0.25
"""A lane this much further away than the nearest one counts as near too."""


@dataclass(frozen=True)
class LaneIndex:
    """Segments of all lanes in a spatial index. `lane` numbers the lines as they were given."""

    starts: Float
    """(S, 2) [m]"""
    vectors: Float
    """(S, 2) [m]"""
    lane: Int
    directed: Bool
    tree: shapely.STRtree

    @classmethod
    def of_lines(cls, lines: Iterable[Float], directed: Iterable[bool]) -> "LaneIndex":
        """Index of centre lines (N, 2) [m]; direction of travel is that of the points where `directed`."""
        lines, flags = [np.asarray(line, dtype=np.float64)[:, :2] for line in lines], list(directed)
        starts = np.concatenate([line[:-1] for line in lines] or [np.zeros((0, 2))])
        ends = np.concatenate([line[1:] for line in lines] or [np.zeros((0, 2))])
        counts = [len(line) - 1 for line in lines]
        tree = shapely.STRtree([shapely.LineString(ends_of) for ends_of in np.stack((starts, ends), axis=1)])
        lane = np.repeat(np.arange(len(lines)), counts)
        return cls(starts, ends - starts, lane, np.repeat(np.array(flags, dtype=np.bool_), counts), tree)

    @classmethod
    def of_map(cls, hd_map: HdMap) -> "LaneIndex":
        """Index of the driving lanes of a source's map."""
        lanes = [lane for lane in hd_map.lanes.values() if lane.kind is LaneKind.DRIVING]
        return cls.of_lines([lane.centre for lane in lanes], [lane.directed for lane in lanes])

    def offsets(self, xy: Float) -> Float:
        """Distance (N,) [m] of points (N, 2) from the nearest centre line; infinite without any lane."""
        distance = np.full(len(xy), np.inf)
        if len(self.starts) and len(xy):
            found, reach = self.tree.query_nearest(shapely.points(xy), all_matches=False, return_distance=True)
            distance[found[0]] = reach
        return distance

    def turned_away(self, xy: Float, yaw: Float, offsets: Float | None = None) -> Float:
        """Angle (N,) [rad] between a heading and the best aligned directed lane near each point; 0 without one.

        Near are all lanes within `SAME_LANE_M`, and the nearest one with those `ALMOST_M` behind it.
        """
        nearest = self.offsets(xy) if offsets is None else offsets
        reach = np.where(np.isfinite(nearest), np.maximum(nearest + ALMOST_M, SAME_LANE_M), 0.0)
        point, segment = self.tree.query(shapely.points(xy), predicate="dwithin", distance=reach)
        point, segment = point[self.directed[segment]], segment[self.directed[segment]]
        direction = np.arctan2(self.vectors[segment, 1], self.vectors[segment, 0])
        away = np.full(len(xy), np.inf)
        np.minimum.at(away, point, np.abs(wrap_angles(direction - yaw[point])))
        return np.where(np.isfinite(away), away, 0.0)


def illegal_jumps(lanes: Sequence[str], connected: Callable[[str, str], bool]) -> int:
    """How often a sequence of lanes (one a frame, "" = none) changes to one that is neither exit nor neighbour."""
    known = [lane for lane in lanes if lane]
    changes = [(a, b) for a, b in pairwise(known) if a != b]
    return sum(not connected(a, b) for a, b in changes)
