"""All courses of a cast in one set of arrays: where everybody is, and what lies ahead, in a few array operations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.actors.motion_path import Course
from mdrive_sumo.core.geometry import Float, Int

ROW = 1e6
"""Knots of row i are found under i * ROW + at, in one search for all rows."""


class Places(NamedTuple):
    """Where courses lead, all of one shape."""

    x: Float
    y: Float
    yaw: Float
    """[rad]; of `ahead` the direction of motion, of `places` the heading."""
    s: Float
    """Arc length [m]."""
    slope: Float
    """Metres a unit of progress: 1 on a path, the speed [m/s] of a replay; 0 behind the end."""


@dataclass(frozen=True, slots=True)
class Tables:
    """Knots of M courses one after another."""

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
    """(M,) of the last one."""

    @property
    def begin(self) -> Float:
        """(M,) least progress."""
        return self.at[self.first]

    @property
    def end(self) -> Float:
        """(M,) greatest progress."""
        return self.at[self.last]

    @property
    def length(self) -> Float:
        """(M,) arc length of the end [m]."""
        return self.columns[3, self.last]

    def places(self, progress: Float) -> Places:
        """(M,) poses at progress (M,); before the begin and behind the end it stands there."""
        rows = np.arange(len(progress))
        before = np.searchsorted(self.by_progress, rows * ROW + progress, side="right") - 1
        before = np.clip(before, self.first, self.last - 1)
        start, end = self.at[before], self.at[before + 1]
        share = np.clip((progress - start) / (end - start), 0.0, 1.0)
        low, high = self.columns[:, before], self.columns[:, before + 1]
        x, y, yaw, s = low + share * (high - low)
        slope = np.where(progress < self.end, (high[3] - low[3]) / (end - start), 0.0)
        return Places(x, y, yaw, s, slope)

    def ahead(self, rows: Int, s: Float) -> Places:
        """(R, K) points of the courses `rows` (R,) at arc lengths s (R, K), and the direction of motion there."""
        first, last = self.first[rows][:, None], self.last[rows][:, None]
        s = np.minimum(s, self.columns[3, last])
        # The begin of the knot's segment: side left, for a replay that stands has many knots of one arc length.
        after = np.searchsorted(self.by_length, rows[:, None] * ROW + s, side="left")
        after = np.clip(after, first + 1, last)
        low, high = self.columns[:, after - 1], self.columns[:, after]
        step = high[3] - low[3]
        share = np.where(step > 0.0, (s - low[3]) / np.where(step > 0.0, step, 1.0), 0.0)
        x, y = low[:2] + share * (high[:2] - low[:2])
        moved = step > 1e-6
        yaw = np.where(moved, np.arctan2(high[1] - low[1], high[0] - low[0]), low[2])
        return Places(x, y, yaw, s, step)


def tables_of(courses: Sequence[Course]) -> Tables:
    """The tables of courses, in their order."""
    counts = np.array([len(course.at) for course in courses], dtype=np.int64)
    last = np.cumsum(counts) - 1
    row = np.repeat(np.arange(len(courses)), counts) * ROW
    at = np.concatenate([np.zeros(0), *(course.at for course in courses)])
    columns = np.concatenate(
        [np.zeros((4, 0)), *(np.stack((course.x, course.y, course.yaw, course.s)) for course in courses)], axis=1
    )
    return Tables(row + at, row + columns[3], columns, at, last - counts + 1, last)
