"""Overlaps of many boxes, and of paths: the footprints of two cars compared at every pair of stations."""

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.planning.parameters import SafetyMargin
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath

SLACK = 1.0 + 1e-9
"""Factor on squared distances: circles that touch up to rounding count as near."""


def compute_footprints(
    path: ReferencePath, length: Float | float, width: float, cells: Int | slice = slice(None)
) -> Float:
    """Return the corners (K, 4, 2) [m] of a box at the given points of a path; length: one, or (K,) [m]."""
    xy = path.xy[cells]
    return boxes_corners(xy[:, 0], xy[:, 1], path.body_yaw[cells], np.asarray(length), np.asarray(width))


@twin
def find_overlapping_pairs(boxes: Float, others: Float, /) -> tuple[Int, Int]:
    """Return the rows (P,) of boxes (A, 4, 2) and (P,) of others (B, 4, 2) that overlap; touching does not count.

    Pairs are sorted by their row in `others`. Those that are far apart are excluded by circles before.
    """
    centre, radius = _measure(boxes)
    other_centre, other_radius = _measure(others)
    gap = other_centre[:, None] - centre
    reach = other_radius[:, None] + radius
    dx, dy = gap[..., 0], gap[..., 1]
    theirs, mine = np.nonzero(dx * dx + dy * dy <= reach * reach * SLACK)
    met = boxes_overlap(boxes[mine], others[theirs])
    return mine[met], theirs[met]


@twin
def compute_overlaps(boxes: Float, others: Float, /) -> Bool:
    """Return a mask (A, B): which of the boxes (A, 4, 2) overlap which of the others (B, 4, 2)."""
    met = np.zeros((len(boxes), len(others)), dtype=np.bool_)
    met[find_overlapping_pairs(boxes, others)] = True
    return met


def _measure(boxes: Float) -> tuple[Float, Float]:
    """Return centres (K, 2) and half diagonals (K,) [m] of boxes (K, 4, 2)."""
    centre = (boxes[:, 0] + boxes[:, 2]) / 2
    gap = boxes[:, 0] - centre
    return centre, portable.hypot(gap[:, 0], gap[:, 1])


def compute_path_overlaps(
    path: ReferencePath, other: ReferencePath, size: tuple[float, float], margin: SafetyMargin, stride: int = 1
) -> Bool:
    """Return a mask (cells of path, cells of other): whether two cars of that size [m] would violate the margin.

    stride: only every such cell of both paths.
    """
    inflated = (size[0] + margin.longitudinal, size[1] + margin.lateral)  # each car keeps half of the margin
    every = slice(None, None, stride)
    return compute_overlaps(compute_footprints(path, *inflated, every), compute_footprints(other, *inflated, every))


def find_cells(path: ReferencePath, s: Float) -> Int:
    """Return the indices (K,) of the path's points nearest to arc lengths s (K,) [m]."""
    return np.minimum(np.maximum(np.rint(s / SPACING_M).astype(np.int64), 0), len(path.xy) - 1)
