"""A LiDAR scan as a bird's-eye histogram, as LMDrive's, TCP's and TransFuser's encoders take it."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.system_spec import LIDAR_BEHIND_M, LIDAR_CELL_M, LIDAR_CELLS, LIDAR_LAYERS
from mdrive_sumo.contract import PointCloud

LIDAR_HEIGHT_M = 2.5
"""Height of the LiDAR above the ground: the default pose of the sensor on a car (docs/range-sensors.md)."""
GROUND_M = 0.4
"""Points lower than that above the ground go to layer 0, higher ones to layer 1."""
MOST = 255


def build_lidar_histogram(cloud: PointCloud) -> npt.NDArray[np.uint8]:
    """Return the numbers of points (LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS) by cell, at most 255 each.

    Row 0 is ahead, column 0 is left; the car looks up and stands `LIDAR_BEHIND_M` above the lower edge. The sensor is
    level and lies above the box centre, `LIDAR_HEIGHT_M` above the ground.
    """
    points, side_m = cloud.points, LIDAR_CELLS * LIDAR_CELL_M
    row = np.floor((side_m - LIDAR_BEHIND_M - points[:, 0]) / LIDAR_CELL_M)
    column = np.floor((side_m / 2 - points[:, 1]) / LIDAR_CELL_M)
    inside = (row >= 0) & (row < LIDAR_CELLS) & (column >= 0) & (column < LIDAR_CELLS)
    layer = points[inside, 2] + LIDAR_HEIGHT_M >= GROUND_M
    cell = (layer * LIDAR_CELLS + row[inside].astype(np.int64)) * LIDAR_CELLS + column[inside].astype(np.int64)
    counts = np.bincount(cell, minlength=LIDAR_LAYERS * LIDAR_CELLS * LIDAR_CELLS)
    return np.minimum(counts, MOST).astype(np.uint8).reshape(LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS)
