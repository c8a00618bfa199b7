"""Many oriented boxes with what their overlap tests need, computed once for all pairs."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int

SLACK = 1.0 + 1e-9
"""Factor on squared distances: circles that touch up to rounding count as near."""
CHUNK = 16
"""Successive boxes that are compared with others by one circle around them: they lie along a path."""


@dataclass(frozen=True, slots=True)
class BoxSet:
    """K boxes: corners, axes of two neighbouring sides, and circles around them."""

    x: Float
    """(K, 4) coordinates of the corners [m]."""
    y: Float
    """(K, 4) likewise, in the order of `x`."""
    axes: Float
    """(2, K, 2) x and y of the two sides."""
    low: Float
    """(K, 2) extremes of the own corners along both sides."""
    high: Float
    """(K, 2) greatest extremes, `low` the least."""
    centre: Float
    """(K, 2) [m]"""
    radius: Float
    """(K,) greatest distance of a corner from the centre [m]."""

    @classmethod
    def build(cls, corners: Float) -> "BoxSet":
        """Return the boxes with corners (K, 4, 2) [m]."""
        x, y = corners[..., 0].copy(), corners[..., 1].copy()
        sides = corners[:, 1:3] - corners[:, 0:2]
        axes = np.array((sides[..., 0], sides[..., 1]))
        low, high = _project(x, y, axes)
        centre = (corners[:, 0] + corners[:, 2]) / 2
        gap_x, gap_y = corners[:, 0, 0] - centre[:, 0], corners[:, 0, 1] - centre[:, 1]
        return cls(x, y, axes, low, high, centre, portable.hypot(gap_x, gap_y))

    def __len__(self) -> int:
        return len(self.x)

    def take(self, rows: Int) -> "BoxSet":
        """Return the boxes of these rows."""
        columns = (self.low[rows], self.high[rows], self.centre[rows], self.radius[rows])
        return BoxSet(self.x[rows], self.y[rows], self.axes[:, rows], *columns)

    def find_pairs(self, others: "BoxSet") -> tuple[Int, Int]:
        """Return the rows (P,) of own boxes and (P,) of others that overlap; touching does not count.

        The order of the pairs is not specified. Pairs that are far apart are excluded by circles before.
        """
        if len(self) <= 2 * CHUNK:
            dx = self.centre[:, 0, None] - others.centre[:, 0]
            dy = self.centre[:, 1, None] - others.centre[:, 1]
            reach = self.radius[:, None] + others.radius
            mine, theirs = np.nonzero(dx * dx + dy * dy <= reach * reach * SLACK)
        else:
            chunks, theirs = self._find_near_chunks(others)
            mine, theirs = (chunks[:, None] * CHUNK + np.arange(CHUNK)).ravel(), theirs.repeat(CHUNK)
            exists = mine < len(self)
            mine, theirs = self._exclude_far(mine[exists], others, theirs[exists])
        met = self._overlap(mine, others, theirs)
        return mine[met], theirs[met]

    def _find_near_chunks(self, others: "BoxSet") -> tuple[Int, Int]:
        """Return numbers of chunks of own boxes and rows of others that may overlap."""
        starts = np.arange(0, len(self), CHUNK)
        low, high = np.array([f.reduceat(self.centre, starts, axis=0) for f in (np.minimum, np.maximum)])
        radius = np.maximum.reduceat(self.radius, starts)
        centre = (low + high) / 2
        reach = (portable.hypot(*(high - centre).T) + radius)[:, None] + others.radius
        dx, dy = centre[:, 0, None] - others.centre[:, 0], centre[:, 1, None] - others.centre[:, 1]
        chunks, rows = np.nonzero(dx * dx + dy * dy <= reach * reach * SLACK)
        return chunks, rows

    def find_overlapping(self, rows: Int, others: "BoxSet", other_rows: Int) -> tuple[Int, Int]:
        """Return the pairs of own `rows` (P,) and `other_rows` (P,) whose boxes overlap."""
        rows, other_rows = self._exclude_far(rows, others, other_rows)
        met = self._overlap(rows, others, other_rows)
        return rows[met], other_rows[met]

    def _exclude_far(self, rows: Int, others: "BoxSet", other_rows: Int) -> tuple[Int, Int]:
        """Return the pairs whose circles touch."""
        dx = self.centre[rows, 0] - others.centre[other_rows, 0]
        dy = self.centre[rows, 1] - others.centre[other_rows, 1]
        reach = self.radius[rows] + others.radius[other_rows]
        near = dx * dx + dy * dy <= reach * reach * SLACK
        return rows[near], other_rows[near]

    def _overlap(self, rows: Int, others: "BoxSet", other_rows: Int) -> Int:
        """Return the places (P,) of the pairs that overlap.

        The separating-axis test of `geometry.boxes_overlap`, with the same operations in the same order.
        """
        met = np.flatnonzero(self._overlap_on_sides(rows, others, other_rows))
        return met[others._overlap_on_sides(other_rows[met], self, rows[met])]

    def _overlap_on_sides(self, rows: Int, others: "BoxSet", other_rows: Int) -> Bool:
        """Return whether pairs overlap when projected on both sides of the own boxes."""
        low, high = _project(others.x[other_rows], others.y[other_rows], self.axes[:, rows])
        overlap = (self.high[rows] > low) & (high > self.low[rows])
        return overlap[:, 0] & overlap[:, 1]


def _project(x: Float, y: Float, axes: Float) -> tuple[Float, Float]:
    """Return the extremes (K, 2) of corners (K, 4) along the two sides of each row."""
    along = x[:, None] * axes[0][..., None] + y[:, None] * axes[1][..., None]
    a, b, c, d = along[..., 0], along[..., 1], along[..., 2], along[..., 3]
    return np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))
