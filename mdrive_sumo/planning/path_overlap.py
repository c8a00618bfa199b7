"""Overlap of paths: the footprints of two cars compared at every pair of stations."""

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.planning.box_set import BoxSet
from mdrive_sumo.planning.parameters import SafetyMargin
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath


def compute_footprints(
    path: ReferencePath, length: Float | float, width: float, cells: Int | slice = slice(None)
) -> Float:
    """Return the corners (K, 4, 2) [m] of a box at the given points of a path; length: one, or (K,) [m]."""
    xy = path.xy[cells]
    return boxes_corners(xy[:, 0], xy[:, 1], path.body_yaw[cells], np.asarray(length), np.asarray(width))


def compute_overlaps(boxes: Float, others: Float) -> Bool:
    """Return a mask (A, B): which of the boxes (A, 4, 2) overlap which of the others (B, 4, 2)."""
    met = np.zeros((len(boxes), len(others)), dtype=np.bool_)
    if met.size:
        met[BoxSet.build(boxes).find_pairs(BoxSet.build(others))] = True
    return met


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
