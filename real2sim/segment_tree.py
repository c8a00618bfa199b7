"""SegmentTree: many line segments with a spatial index, and the distances of points from those near them.

Distances have the bits of GEOS: its formulas, in its order of operations, for all pairs of a point and a segment at
once instead of pair by pair.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, Int

BOX_MARGIN_M = 1e-3
"""[m] Boxes around points are larger by this, so that rounding leaves no segment out."""


class NearSegments(NamedTuple):
    """Pairs (P,) of a point and a segment near it, ordered by point."""

    point: Int
    segment: Int
    distance: Float
    """[m]"""
    share: Float
    """Where the foot of the point lies on the line through the segment: 0 where that begins, 1 where it ends."""


@dataclass(frozen=True, eq=False)
class SegmentTree:
    """The segments (S,) of lines, one line after the other."""

    begin: Float
    """First points (S, 2) [m]."""
    end: Float
    """Last points (S, 2) [m]."""
    vector: Float
    """From the first to the last points (S, 2) [m]."""
    squared: Float
    """Squared lengths (S,) [m²]."""
    line: Int
    """The line (S,) to which each belongs."""
    tree: shapely.STRtree

    @classmethod
    def from_lines(cls, lines: Sequence[Float]) -> "SegmentTree":
        """Return the segments of lines through points (N, 2) [m]; those of a single point have none."""
        none = np.zeros((0, 2))
        begin, end = (
            np.concatenate([none, *(xy[:-1] for xy in lines)]),
            np.concatenate([none, *(xy[1:] for xy in lines)]),
        )
        vector = end - begin
        drawn: Any = shapely.linestrings(np.stack((begin, end), axis=1))
        return cls(
            begin,
            end,
            vector,
            vector[:, 0] * vector[:, 0] + vector[:, 1] * vector[:, 1],
            np.repeat(np.arange(len(lines)), [max(len(xy) - 1, 0) for xy in lines]),
            shapely.STRtree(drawn),
        )

    def find_nearest(self, xy: Float) -> tuple[Int, Int, Float]:
        """Return the points that have a nearest segment, that segment, and the distance [m]."""
        (point, segment), distance = self.tree.query_nearest(
            shapely.points(xy), all_matches=False, return_distance=True
        )
        return point, segment, distance

    def find_near(self, xy: Float, reach: Float | float) -> NearSegments:
        """Return all segments within `reach` [m], a number or one for each point, of points xy (N, 2) [m]."""
        reaches = np.broadcast_to(reach, len(xy))
        margin = reaches + BOX_MARGIN_M
        x, y = xy.T
        boxes: Any = shapely.box(x - margin, y - margin, x + margin, y + margin)
        point, segment = self.tree.query(boxes)
        distance, share = self._measure(xy[point], segment)
        near = distance <= reaches[point]
        return NearSegments(point[near], segment[near], distance[near], share[near])

    def _measure(self, xy: Float, segment: Int) -> tuple[Float, Float]:
        after, before, vector = xy - self.begin[segment], xy - self.end[segment], self.vector[segment]
        is_point = self.squared[segment] <= 0.0
        squared = np.where(is_point, 1.0, self.squared[segment])
        share = np.where(is_point, 0.0, (after[:, 0] * vector[:, 0] + after[:, 1] * vector[:, 1]) / squared)
        beside = np.abs((after[:, 0] * vector[:, 1] - after[:, 1] * vector[:, 0]) / squared) * np.sqrt(squared)
        corner = np.where((share <= 0.0)[:, None], after, before)
        beyond = np.sqrt(corner[:, 0] * corner[:, 0] + corner[:, 1] * corner[:, 1])
        return np.where((share <= 0.0) | (share >= 1.0), beyond, beside), share


def find_first(*keys: Int) -> Bool:
    """Return a mask (N,) of the first of equal rows in a row of several keys (N,)."""
    is_first = np.ones(len(keys[0]), dtype=np.bool_)
    is_first[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    return is_first
