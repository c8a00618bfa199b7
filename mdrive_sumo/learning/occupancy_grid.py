"""Occupancy as a label: which cells of the LiDAR histogram's grid boxes cover."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.system_spec import LIDAR_BEHIND_M, LIDAR_CELL_M, LIDAR_CELLS
from mdrive_sumo.core.geometry import Float, Int, boxes_corners
from mdrive_sumo.sensing.polygon_fill import box_edges, fill_polygons

PARTS = 3
"""A cell is covered if one of 3 x 3 points in it is: points 0.25 m apart, because people are smaller than cells."""
POINT_M = LIDAR_CELL_M / PARTS
AHEAD_M, LEFT_M = LIDAR_CELLS * LIDAR_CELL_M - LIDAR_BEHIND_M, LIDAR_CELLS * LIDAR_CELL_M / 2
"""Upper and left edge of the grid from the box centre."""


def rasterize_boxes(poses: Float, sizes: Float, layer: Int, layers: int) -> npt.NDArray[np.uint8]:
    """Return a mask (layers, LIDAR_CELLS, LIDAR_CELLS) of 0 and 1: 1 where a box covers a part of a cell.

    poses: (K, 3) x, y [m], yaw [rad] in the ego frame. sizes: (K, 2) length, width [m]. layer: (K,). Row 0 is ahead,
    column 0 is left.
    """
    corners = boxes_corners(*poses.T, *sizes.T)
    pixels = np.stack(((LEFT_M - corners[..., 1]) / POINT_M, (AHEAD_M - corners[..., 0]) / POINT_M), axis=-1)
    size = LIDAR_CELLS * PARTS
    covered = fill_polygons(box_edges(pixels), np.repeat(layer, 4), (layers, size))
    rows = np.bitwise_or.reduce([covered[:, part::PARTS] for part in range(PARTS)])  # faster than any(axis)
    return np.bitwise_or.reduce([rows[:, :, part::PARTS] for part in range(PARTS)]) & np.uint8(1)
