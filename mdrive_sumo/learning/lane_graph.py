"""The lane graph as a label: centre lines near the car, each as ten points."""

from functools import lru_cache

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.learning.sample_format import LANE_POINTS, MAX_LANES
from mdrive_sumo.roads import RoadMap

LANE_REACH_M = 40.0
SPACING_M = 1.0


class LaneGraph:
    """The centre lines of a map as points 1 m apart."""

    def __init__(self, roads: RoadMap) -> None:
        lines = [lane.centre.resample(SPACING_M).xy for lane in roads.driving]
        self._xy: Float = np.concatenate(lines)
        self._lane: Int = np.repeat(np.arange(len(lines)), [len(line) for line in lines])

    def find_lines(self, x: float, y: float) -> Float:
        """Return the lines (L, LANE_POINTS, 2) [m, world] within `LANE_REACH_M` of a place, the nearest ones first.

        A line is cut where it leaves the circle; of a lane that enters it several times the longest part counts.
        """
        distance = portable.hypot(self._xy[:, 0] - x, self._xy[:, 1] - y)
        near = np.flatnonzero(distance <= LANE_REACH_M)
        if not len(near):
            return np.zeros((0, LANE_POINTS, 2))
        breaks = np.flatnonzero((np.diff(near) != 1) | (np.diff(self._lane[near]) != 0)) + 1
        begin, end = np.concatenate(((0,), breaks)), np.concatenate((breaks, (len(near),)))
        begin, end = self._choose_longest(near, begin, end)
        gap = np.array([distance[near[i:j]].min() for i, j in zip(begin.tolist(), end.tolist(), strict=True)])
        order = np.argsort(gap, kind="stable")[:MAX_LANES]
        first, last = near[begin[order]], near[end[order] - 1]
        return self._resample(first, last)

    def _choose_longest(self, near: Int, begin: Int, end: Int) -> tuple[Int, Int]:
        """Return the longest part of every lane, without those of a single point."""
        length, lane = end - begin, self._lane[near[begin]]
        order = np.lexsort((begin, -length, lane))
        is_first = np.concatenate(((True,), np.diff(lane[order]) != 0))
        chosen = np.sort(order[is_first & (length[order] > 1)], kind="stable")
        return begin[chosen], end[chosen]

    def _resample(self, first: Int, last: Int) -> Float:
        place = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, LANE_POINTS)
        low = np.minimum(place.astype(np.int64), np.maximum(last - 1, first)[:, None])
        share = (place - low)[..., None]
        return self._xy[low] * (1.0 - share) + self._xy[low + 1] * share


@lru_cache(maxsize=8)
def load_lane_graph(roads: RoadMap) -> LaneGraph:
    """Return the lane graph of a map, cached."""
    return LaneGraph(roads)
