"""Maps of occupancy: boxes drawn into the cells of the detection head, and what a planner reads at places and times."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.fusion_spec import FORECAST_S, GRID_REACH_M, OUTPUT_CELL_M, OUTPUT_CELLS
from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, wrap_angles
from mdrive_sumo.core.state import DT

LEAST_SIDE_M = 1.15
"""Boxes are drawn no smaller, so that each covers the centre of at least one cell: the diagonal of one is 1.13 m."""


def draw_boxes(boxes: Float) -> npt.NDArray[np.float32]:
    """Return maps (T, OUTPUT_CELLS, OUTPUT_CELLS) of 0 and 1: a cell is covered if its centre lies in a box.

    boxes: (M, T, 5) x, y [m], yaw [rad], length, width [m] in the own frame.
    """
    times = boxes.shape[1]
    maps = np.zeros((times, OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    offsets = GRID_REACH_M - (np.arange(OUTPUT_CELLS) + 0.5) * OUTPUT_CELL_M
    for box in boxes:
        for time in range(times):
            x, y, yaw, length, width = box[time].tolist()
            half_length, half_width = max(length, LEAST_SIDE_M) / 2, max(width, LEAST_SIDE_M) / 2
            rows, columns = (_find_span(centre, half_length + half_width) for centre in (x, y))
            ahead, left = offsets[rows, None] - x, offsets[None, columns] - y
            cos, sin = portable.cos_sin(yaw)
            is_covered = np.abs(cos * ahead + sin * left) <= half_length
            is_covered &= np.abs(cos * left - sin * ahead) <= half_width
            maps[time, rows, columns][is_covered] = 1.0
    return maps


def _find_span(centre: float, reach: float) -> slice:
    """Return the rows or columns within a reach [m] of a coordinate [m]."""
    low = int((GRID_REACH_M - centre - reach) / OUTPUT_CELL_M) - 1
    high = int((GRID_REACH_M - centre + reach) / OUTPUT_CELL_M) + 2
    return slice(min(max(low, 0), OUTPUT_CELLS), min(max(high, 0), OUTPUT_CELLS))


def draw_tracks(objects: Objects, own: OwnState) -> npt.NDArray[np.float32]:
    """Return where objects would be at FORECAST_S at constant velocity, seen from the own pose: `tracks` of a network.

    Objects are those at the tick of the pose, in the world frame.
    """
    places = convert_to_frame(np.column_stack((objects.x, objects.y)), np.array((own.x, own.y, own.yaw)))
    yaw = wrap_angles(objects.yaw - own.yaw)
    cos, sin = portable.cos_sin(yaw)
    way = objects.speed[:, None] * np.array(FORECAST_S)
    x, y = places[:, :1] + cos[:, None] * way, places[:, 1:] + sin[:, None] * way
    rest = (np.repeat(each[:, None], len(FORECAST_S), axis=1) for each in (yaw, objects.length, objects.width))
    return draw_boxes(np.stack((x, y, *rest), axis=-1))


@dataclass(frozen=True, slots=True)
class OccupancyForecast:
    """How likely cells around a car are occupied, as its network forecast from one scan."""

    tick: int
    """Of the scan."""
    pose: Float
    """(3,) x, y [m], yaw [rad] in the world, where the car took itself to be then."""
    occupied: npt.NDArray[np.float32]
    """(len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS) probabilities at FORECAST_S."""

    def look_up(self, points: Float, after_s: Float, tick: int) -> Float:
        """Return probabilities (..., T, P) at world points (..., T, P, 2) [m] at times (T,) [s] after a tick.

        Between two times of the forecast the larger probability counts, after the last one the last. Outside of the
        grid nothing is known, and nothing is expected.
        """
        ego = convert_to_frame(points, self.pose)
        row, column = (np.floor((GRID_REACH_M - ego[..., axis]) / OUTPUT_CELL_M).astype(np.int64) for axis in (0, 1))
        inside = (row >= 0) & (row < OUTPUT_CELLS) & (column >= 0) & (column < OUTPUT_CELLS)
        row, column = np.where(inside, row, 0), np.where(inside, column, 0)
        age_s = after_s + (tick - self.tick) * DT
        last = len(FORECAST_S) - 1
        later = np.minimum(np.searchsorted(np.array(FORECAST_S), age_s - 1e-6, side="left"), last)
        sooner = np.minimum(np.searchsorted(np.array(FORECAST_S), age_s + 1e-6, side="right") - 1, last)
        found = [self.occupied[index[:, None], row, column] for index in (np.maximum(sooner, 0), later)]
        return np.where(inside, np.maximum(*found), np.float32(0.0)).astype(np.float64)
