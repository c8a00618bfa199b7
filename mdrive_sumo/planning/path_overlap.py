"""Where two paths are in each other's way: the footprints of two cars compared at every pair of stations."""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.planning.path import SPACING_M, Path


class Margin(NamedTuple):
    """Free space between two cars [m]: lengthwise, and sideways."""

    along: float
    across: float


PLAN_MARGIN = Margin(0.9, 0.4)
"""When planning: for tracking errors and the motion between two samples."""
CHECK_MARGIN = Margin(0.3, 0.15)
"""Of a plan that is still good: less, so that rounding does not upset it."""
TOUCHING = Margin(0.05, 0.1)
"""Where the plan's margin is violated already."""


def footprints(path: Path, length: float, width: float, cells: Int | slice = slice(None)) -> Float:
    """Corners (K, 4, 2) [m] of a box of that size at the given points of a path."""
    xy = path.xy[cells]
    return boxes_corners(xy[:, 0], xy[:, 1], path.body_yaw[cells], np.asarray(length), np.asarray(width))


def overlaps(mine: Float, others: Float) -> Bool:
    """Which of my footprints (A, 4, 2) overlap which of the others' (B, 4, 2): (A, B)."""
    reach = _reach(mine) + _reach(others)
    gap = mine.mean(1)[:, None] - others.mean(1)[None]
    near = (gap**2).sum(-1) < reach**2
    a, b = np.nonzero(near)
    near[a, b] = boxes_overlap(mine[a], others[b])
    return near


def _reach(corners: Float) -> float:
    """Greatest distance [m] of a corner from its box's centre."""
    if not len(corners):
        return 0.0
    return float(np.linalg.norm(corners - corners.mean(1, keepdims=True), axis=-1).max())


def path_overlaps(one: Path, other: Path, size: tuple[float, float], margin: Margin) -> Bool:
    """Whether two cars of that size [m] would be closer than the margin: (cells of one, cells of other)."""
    inflated = (size[0] + margin.along, size[1] + margin.across)  # each keeps half of the margin
    return overlaps(footprints(one, *inflated), footprints(other, *inflated))


def cells_of(path: Path, s: Float) -> Int:
    """Indices (K,) of the path's points nearest to arc lengths s (K,) [m]."""
    return np.clip(np.round(s / SPACING_M).astype(np.int64), 0, len(path.xy) - 1)
