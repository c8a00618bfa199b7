"""All speed profiles of a CAV along its whole route, as ways through a grid of stations and kinetic energies.

Over a stretch of the same length, the same acceleration changes the squared speed by the same amount whatever the
speed is. In a grid whose cells are equally wide in v²/2, and whose stations are equally far apart, a drive that
accelerates and brakes within its limits therefore changes by a fixed number of cells at most between two stations, and
no rounding adds up: every real drive has a way through the cells, and a way differs from a real drive by one cell.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.study.need.motion import STEP_M, RouteMotion

CELLS_PER_STEP = 8
"""Cells that full acceleration rises between two stations: the first cell ends at 0.75 m/s, and one at 10 m/s is
0.03 m/s wide."""
RANGE_SPEED = 1.0
"""Width [m/s] of the ranges of speed in which states are judged together, half of that below `SLOW_SPEED`."""
SLOW_SPEED = 3.0


@dataclass(frozen=True)
class SpeedGrid:
    """N stations every `STEP_M`, and C cells of speed."""

    motion: RouteMotion

    @cached_property
    def steps(self) -> int:
        """Number of steps from the start to the least station at which the route can count as completed."""
        return max(min(int(self.motion.goal_m / STEP_M), len(self.motion.caps) - 1), 1)

    @cached_property
    def _width(self) -> float:
        """Width of a cell in v²/2 [m²/s²]."""
        return self.motion.limits.acceleration * STEP_M / CELLS_PER_STEP

    @cached_property
    def bounds(self) -> Float:
        """(C + 1,) bounds of the cells [m/s]."""
        top = max(self.motion.top_speed, self.motion.start_speed)
        count = math.floor(top * top / 2.0 / self._width + 1e-9) + 1
        return np.sqrt(2.0 * self._width * np.arange(count + 1))

    def find_cell(self, speed: float) -> int:
        """Return the cell of a speed [m/s]."""
        return min(math.floor(speed * speed / 2.0 / self._width + 1e-9), len(self.bounds) - 2)

    @cached_property
    def ranges(self) -> Int:
        """(R + 1,) first cell of every range of speed, and the number of cells."""
        firsts = [0]
        for cell, (slow, fast) in enumerate(pairwise(self.bounds.tolist())):
            begin = float(self.bounds[firsts[-1]])
            if cell > firsts[-1] and fast - begin > RANGE_SPEED * (1.0 if slow >= SLOW_SPEED else 0.5):
                firsts.append(cell)
        return np.array([*firsts, len(self.bounds) - 1])

    def find_range(self, cell: int) -> int:
        """Return the range of speed of a cell."""
        return int(np.searchsorted(self.ranges, cell, side="right")) - 1

    @cached_property
    def _drop(self) -> int:
        """Cells that full braking falls at most between two stations."""
        return math.ceil(self.motion.deceleration * STEP_M / self._width - 1e-9)

    @cached_property
    def _step_times(self) -> Float:
        """(CELLS_PER_STEP + drop + 1, C) least time [s] of a step that ends in a cell, by the cell where it begins.

        The first row belongs to begins `CELLS_PER_STEP` cells below the end, the last to those `drop` cells above.
        Within a step a car accelerates and then brakes; both ends count at the greatest speed of their cells.
        """
        limits, gain, brake = self.motion.limits, self.motion.limits.acceleration, self.motion.deceleration
        end = np.arange(len(self.bounds) - 1)
        begin = end + np.arange(-CELLS_PER_STEP, self._drop + 1)[:, None]
        exists = (begin >= 0) & (begin < len(end))
        clipped = np.clip(begin, 0, len(end) - 1)
        v, w = self.bounds[clipped + 1], self.bounds[end + 1]
        peak = np.sqrt(np.maximum(v * v + gain * (w * w - v * v + 2.0 * brake * STEP_M) / (gain + brake), 0.0))
        peak = np.maximum(peak, np.maximum(v, w))
        power = np.minimum(gain, limits.power_per_mass / np.maximum(self.bounds[clipped], 1e-3))
        can_rise = end - begin <= np.ceil(power * STEP_M / self._width - 1e-9)
        return np.where(exists & can_rise, (peak - v) / gain + (peak - w) / brake, np.inf)

    @cached_property
    def _times_by_cap(self) -> dict[tuple[float, float], Float]:
        return {}

    def _cap_times(self, step: int) -> Float:
        """Return the least times of a step within the speed limits; infinite if it ends above that of its end."""
        caps = self.motion.caps
        ends = float(caps[step]), float(caps[min(step + 1, len(caps) - 1)])
        if ends not in self._times_by_cap:
            too_fast = self.bounds[:-1] > ends[1] + 1e-9
            self._times_by_cap[ends] = np.where(too_fast, np.inf, np.maximum(self._step_times, STEP_M / max(ends)))
        return self._times_by_cap[ends]

    def start(self) -> Float:
        """Return (C,) the least times [s] at the first station: 0 in the cell of the start's speed."""
        times = np.full(len(self.bounds) - 1, np.inf)
        times[self.find_cell(self.motion.start_speed)] = 0.0
        return times

    def advance(self, times: Float, step: int) -> Float:
        """Return (C,) the least times [s] after a step, given those (C,) before it; infinite where no drive comes."""
        return (self._list_begins(times) + self._cap_times(step)).min(axis=0)

    def go_back(self, remaining: Float, step: int) -> Float:
        """Return (C,) the least times [s] to the goal before a step, given those (C,) after it."""
        added = self._cap_times(step) + remaining
        cells, rows = len(remaining), len(added)
        padded = np.full((rows, cells + rows - 1), np.inf)
        padded[:, self._drop : self._drop + cells] = added
        # Row r holds steps that begin r - CELLS_PER_STEP cells above their end.
        return np.stack([padded[r, rows - 1 - r : rows - 1 - r + cells] for r in range(rows)]).min(axis=0)

    def find_begin(self, times: Float, step: int, cell: int) -> int:
        """Return the cell before a step from which the given one is reached first."""
        added = self._list_begins(times)[:, cell] + self._cap_times(step)[:, cell]
        return int(added.argmin()) + cell - CELLS_PER_STEP

    def _list_begins(self, times: Float) -> Float:
        """Return the times of the cells where a step may begin, by its end, in the order of `_step_times`."""
        padded = np.concatenate((np.full(CELLS_PER_STEP, np.inf), times, np.full(self._drop, np.inf)))
        # As `sliding_window_view`, which takes longer than the whole sum that follows.
        return np.ndarray((CELLS_PER_STEP + self._drop + 1, len(times)), buffer=padded, strides=padded.strides * 2)
