"""Where two paths are in each other's way: the footprints of two cars compared at every pair of stations."""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.agents.path import SPACING_M, Path
from mdrive_sumo.geometry import Bool, Float, Int, boxes_corners, boxes_overlap


class Margin(NamedTuple):
    """Free space around a car [m]: ahead and behind, and on either side."""

    along: float
    across: float


PLAN_MARGIN = Margin(0.8, 0.35)
"""When planning: for tracking errors and the motion between two samples."""
CHECK_MARGIN = Margin(0.3, 0.15)
"""Of a plan that is still good: less, so that rounding does not upset it."""
NO_MARGIN = Margin(0.0, 0.0)

COARSE = 2
"""Footprints are compared at every second point of a path, 0.5 m apart."""


def footprints(path: Path, length: float, width: float, cells: Int | slice = slice(None)) -> Float:
    """Corners (K, 4, 2) [m] of a box of that size at the given points of a path."""
    xy = path.xy[cells]
    return boxes_corners(xy[:, 0], xy[:, 1], path.body_yaw[cells], np.float64(length), np.float64(width))


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
    return float(np.linalg.norm(corners - corners.mean(1, keepdims=True), axis=-1).max()) if len(corners) else 0.0


def path_overlaps(mine: Path, other: Path, size: tuple[float, float], margin: Margin) -> Bool:
    """Whether a car at my cell i would come too near to one at the other's cell j: (cells of mine, cells of other).

    size: length and width [m] of both cars.
    """
    every = slice(None, None, COARSE)
    inflated = footprints(mine, size[0] + 2 * margin.along, size[1] + 2 * margin.across, every)
    coarse = overlaps(inflated, footprints(other, *size, every))
    fine = np.repeat(np.repeat(coarse, COARSE, axis=0), COARSE, axis=1)
    return fine[: len(mine.xy), : len(other.xy)]


def cells_of(path: Path, s: Float) -> Int:
    """Indices (K,) of the path's points nearest to arc lengths s (K,) [m]."""
    return np.clip(np.round(s / SPACING_M).astype(np.int64), 0, len(path.xy) - 1)
