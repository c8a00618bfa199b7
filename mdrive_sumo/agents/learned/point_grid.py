"""The point grid: a LiDAR scan as counts of points by height layer and cell.

A scan is kept and sent as its occupied cells, one number each: the index of the cell times 256 plus its count. The
index counts layers, then rows, then columns.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import (
    GRID_CELL_M,
    GRID_CELLS,
    GRID_LAYERS,
    GRID_REACH_M,
    LAYER_EDGES_M,
    MAX_COUNT,
)
from mdrive_sumo.agents.learned.network_inputs import LIDAR_HEIGHT_M, LIDAR_ID
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin

Cells = npt.NDArray[np.uint32]
"""(K,) occupied cells, in ascending order."""
GRID_SIZE = GRID_LAYERS * GRID_CELLS * GRID_CELLS
"""Number of cells in all layers."""


SCAN_SENSOR = SensorSpec("lidar", LIDAR_ID, options={"profile": "lmdrive"})
"""What makes the scans of training and of drives: 60 032 rays, in even ticks."""
_EDGES_M = np.asarray(LAYER_EDGES_M, np.float32) - np.float32(LIDAR_HEIGHT_M)
"""[m] Between the layers, in the frame of the sensor."""


def build_point_cells(points: npt.NDArray[np.float32]) -> Cells:
    """Return the occupied cells of a scan; points: (N, 3 or more) x, y, z [m] in the frame of the level sensor.

    The sensor lies above the box centre, `LIDAR_HEIGHT_M` above the ground. Points outside of the grid are dropped.
    """
    return count_points(np.asarray(points, np.float32), _EDGES_M).astype(np.uint32)


@twin
def count_points(points: npt.NDArray[np.float32], edges: npt.NDArray[np.float32], /) -> npt.NDArray[np.int64]:
    """Return the occupied cells (K,) of points (N, 3 or more) [m], ascending; edges: (7,) [m] between the layers."""
    row, column = _locate(points)
    inside = np.flatnonzero(_is_inside(row, column))
    layer = (points[inside, 2, None] >= edges).sum(axis=1)
    index = (layer * GRID_CELLS + row[inside].astype(np.int64)) * GRID_CELLS + column[inside].astype(np.int64)
    cells, counts = np.unique(index, return_counts=True)
    return cells * 256 + np.minimum(counts, MAX_COUNT)


def find_points_inside(points: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Return which of the points (N, 2 or more) [m] `build_point_cells` counts."""
    return _is_inside(*_locate(points))


def _locate(points: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return row and column of each point (N,), with fractions."""
    per_metre, reach = np.float32(1.0 / GRID_CELL_M), np.float32(GRID_REACH_M)
    return (reach - points[:, 0]) * per_metre, (reach - points[:, 1]) * per_metre


def _is_inside(row: npt.NDArray[Any], column: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    return (row >= 0) & (row < GRID_CELLS) & (column >= 0) & (column < GRID_CELLS)


_LOG_COUNTS = portable.log(1.0 + np.arange(MAX_COUNT + 1)).astype(np.float32)


def expand_cells(cells: Cells) -> npt.NDArray[np.float32]:
    """Return the grid (GRID_LAYERS, GRID_CELLS, GRID_CELLS) of occupied cells: ln(1 + count), what networks take."""
    grid = np.zeros(GRID_SIZE, np.float32)
    grid[cells >> 8] = _LOG_COUNTS[cells & 255]  # in a network, logarithms of all cells would take 1.5 ms
    return grid.reshape(GRID_LAYERS, GRID_CELLS, GRID_CELLS)


def merge_cells(scans: list[Cells], poses: npt.NDArray[np.floating]) -> Cells:
    """Return the cells of several cars' scans in the frame of the first: what early fusion sees.

    poses: (N, 3) x, y [m], yaw [rad] of each car in that frame. A cell moves as a whole, to the cell that holds its
    centre; counts are added.
    """
    total = np.zeros(GRID_SIZE, np.int64)
    for cells, (x, y, yaw) in zip(scans, poses.tolist(), strict=True):
        index, is_inside = _move_cells((cells >> 8).astype(np.int64), x, y, yaw)
        np.add.at(total, index[is_inside], (cells & 255)[is_inside])
    occupied = np.flatnonzero(total)
    return (occupied * 256 + np.minimum(total[occupied], MAX_COUNT)).astype(np.uint32)


def _move_cells(
    index: npt.NDArray[np.int64], x: float, y: float, yaw: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return the cells that hold the moved centres of cells, and whether they lie inside the grid."""
    cos, sin = portable.cos_sin(yaw)
    ahead = GRID_REACH_M - ((index // GRID_CELLS) % GRID_CELLS + 0.5) * GRID_CELL_M
    left = GRID_REACH_M - (index % GRID_CELLS + 0.5) * GRID_CELL_M
    row = np.floor((GRID_REACH_M - (x + cos * ahead - sin * left)) / GRID_CELL_M).astype(np.int64)
    column = np.floor((GRID_REACH_M - (y + sin * ahead + cos * left)) / GRID_CELL_M).astype(np.int64)
    layer = index // (GRID_CELLS * GRID_CELLS)
    return (layer * GRID_CELLS + row) * GRID_CELLS + column, _is_inside(row, column)
