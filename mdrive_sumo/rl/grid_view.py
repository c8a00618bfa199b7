"""Grids around a CAV in an observation: its bird's-eye raster, or its LiDAR scan as counts of points.

Row 0 is ahead, column 0 is left, and the car looks up; both come from the CAV's own sensors.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.network_inputs import LIDAR_ID, build_lidar_histogram
from mdrive_sumo.agents.learned.system_spec import LIDAR_CELLS, LIDAR_LAYERS
from mdrive_sumo.contract import Observation, SensorSpec
from mdrive_sumo.sensing.raster_sensor import LAYERS

RASTER = "raster"
GRIDS = (RASTER, "lidar")
"""What a grid is made of: `raster` has the layers of the sensor `bev`, 0 or 255; `lidar` those of the system `lmdrive`:
the number of points in a cell on the ground, and above it."""
RASTER_CELLS, RASTER_CELL_M = 64, 1.0
"""A car's stopping distance at 50 km/h to all sides, and two cells across a car: the raster takes a millisecond."""


class GridShape(NamedTuple):
    """The shape of a grid."""

    layers: int
    rows: int
    columns: int


def describe_grid(kind: str) -> GridShape:
    """Return the shape of a grid; that of none ("") has no cells."""
    if not kind:
        return GridShape(0, 0, 0)
    if kind == RASTER:
        return GridShape(len(LAYERS), RASTER_CELLS, RASTER_CELLS)
    return GridShape(LIDAR_LAYERS, LIDAR_CELLS, LIDAR_CELLS)


def list_grid_sensors(kind: str, ticks_per_decision: int) -> tuple[SensorSpec, ...]:
    """Return the sensor that a grid needs; it scans when the policy decides. A raster is drawn in every tick."""
    if not kind:
        return ()
    if kind == RASTER:
        return (SensorSpec("bev", RASTER, options={"size": RASTER_CELLS, "metres_per_pixel": RASTER_CELL_M}),)
    return (SensorSpec("lidar", LIDAR_ID, options={"every_ticks": ticks_per_decision}),)


def read_grid(kind: str, seen: Observation) -> npt.NDArray[np.uint8]:
    """Return the grid (layers, rows, columns) of an observation in a tick of a decision."""
    pixels: Any = seen.bev[RASTER].pixels if kind == RASTER else build_lidar_histogram(seen.lidar[LIDAR_ID])
    return pixels
