"""The bird's-eye grid of all networks: 32 x 32 cells over the area of the LiDAR histogram."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.system_spec import LIDAR_BEHIND_M, LIDAR_CELL_M, LIDAR_CELLS

Float = npt.NDArray[np.float64]
BEV_CELLS = 32
BEV_AREA_M = LIDAR_CELLS * LIDAR_CELL_M
BEV_CELL_M = BEV_AREA_M / BEV_CELLS
BEV_AHEAD_M = BEV_AREA_M - LIDAR_BEHIND_M
"""[m] x of the upper edge (row 0); y of the left edge (column 0) is half of the area."""
BEV_LEFT_M = BEV_AREA_M / 2
"""[m] y of the left edge (column 0): the car stands in the middle."""
BEV_CHANNELS = 64


def compute_cell_centres() -> Float:
    """Return the centres (BEV_CELLS, BEV_CELLS, 2) x, y [m] of the cells, in the ego frame."""
    offsets = (np.arange(BEV_CELLS) + 0.5) * BEV_CELL_M
    x, y = np.meshgrid(BEV_AHEAD_M - offsets, BEV_LEFT_M - offsets, indexing="ij")
    return np.stack((x, y), axis=-1).astype(np.float64)
