"""All paths in one set of arrays, to interpolate the poses of all actors in a few array operations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.actors.motion_path import MotionPath
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int

ROW_STRIDE = 1e6
"""Offset between the search keys of successive paths: knots of path i have the keys i * ROW_STRIDE + progress."""


class PathPoints(NamedTuple):
    """Points on paths; all arrays have one shape."""

    x: Float
    y: Float
    yaw: Float
    """[rad] Heading from `interpolate`, direction of motion from `sample_ahead`."""
    s: Float
    """Arc length [m]."""
    slope: Float
    """Arc length per unit of progress: 1 on a path, the speed [m/s] of a replay; 0 beyond the end."""


@dataclass(frozen=True, slots=True)
class PathTables:
    """The K knots of M paths, one path after another."""

    by_progress: Float
    """(K,) row * ROW + at"""
    by_length: Float
    """(K,) row * ROW + s"""
    columns: Float
    """(4, K) x, y, yaw, s"""
    at: Float
    first: Int
    """(M,) index of the first knot."""
    last: Int
    """(M,) index of the last knot."""

    @property
    def begin(self) -> Float:
        """(M,) progress at the start."""
        return self.at[self.first]

    @property
    def end(self) -> Float:
        """(M,) progress at the end."""
        return self.at[self.last]

    @property
    def length(self) -> Float:
        """(M,) arc length of the end [m]."""
        return self.columns[3, self.last]

    def interpolate(self, progress: Float) -> PathPoints:
        """Return the (M,) points at progress (M,), clamped to the ends of the paths."""
        rows = np.arange(len(progress))
        before = np.searchsorted(self.by_progress, rows * ROW_STRIDE + progress, side="right") - 1
        before = np.clip(before, self.first, self.last - 1)
        start, end = self.at[before], self.at[before + 1]
        share = np.clip((progress - start) / (end - start), 0.0, 1.0)
        low, high = self.columns[:, before], self.columns[:, before + 1]
        x, y, yaw, s = low + share * (high - low)
        slope = np.where(progress < self.end, (high[3] - low[3]) / (end - start), 0.0)
        return PathPoints(x, y, yaw, s, slope)

    def sample_ahead(self, rows: Int, s: Float) -> PathPoints:
        """Return the (R, K) points of the paths `rows` (R,) at arc lengths s (R, K), with directions of motion."""
        first, last = self.first[rows][:, None], self.last[rows][:, None]
        s = np.minimum(s, self.columns[3, last])
        # side="left" finds the first of the equal arc lengths of a replay that stands.
        after = np.searchsorted(self.by_length, rows[:, None] * ROW_STRIDE + s, side="left")
        after = np.clip(after, first + 1, last)
        low, high = self.columns[:, after - 1], self.columns[:, after]
        step = high[3] - low[3]
        share = np.where(step > 0.0, (s - low[3]) / np.where(step > 0.0, step, 1.0), 0.0)
        x, y = low[:2] + share * (high[:2] - low[:2])
        moved = step > 1e-6
        yaw = np.where(moved, portable.atan2(high[1] - low[1], high[0] - low[0]), low[2])
        return PathPoints(x, y, yaw, s, step)


def build_path_tables(paths: Sequence[MotionPath]) -> PathTables:
    """Return the tables of paths, in their order."""
    counts = np.array([len(course.progress) for course in paths], dtype=np.int64)
    last = np.cumsum(counts) - 1
    row = np.repeat(np.arange(len(paths)), counts) * ROW_STRIDE
    at = np.concatenate([np.zeros(0), *(course.progress for course in paths)])
    columns = np.concatenate(
        [np.zeros((4, 0)), *(np.stack((course.x, course.y, course.yaw, course.s)) for course in paths)], axis=1
    )
    return PathTables(row + at, row + columns[3], columns, at, last - counts + 1, last)
