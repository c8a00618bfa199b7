"""False positives of a detector profile: cars that are not there, each for an epoch of half a second.

They are drawn by the cells of a grid. The random numbers depend on (seed, cell, epoch) only, so that a draw for all
cells around a sensor serves all ticks of the epoch.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import FAR_M, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Float
from mdrive_sumo.core.seeding import draw_first_uniform, draw_uniforms
from mdrive_sumo.core.state import Kind
from mdrive_sumo.sensing.detection_noise import EPOCH_TICKS, draw_phase

CELL_M = 50.0
"""Edge of the grid cells for which false positives are drawn."""
CAR_M = (4.5, 1.9)
"""Length and width of a false positive."""


class _CellRange(NamedTuple):
    """Cells (i, j) of the grid, the last ones included."""

    first_i: int
    first_j: int
    last_i: int
    last_j: int


class _FalsePositive(NamedTuple):
    """One of a cell (i, j). The epochs of the cell begin `phase` ticks before those of phase 0."""

    i: int
    j: int
    phase: int
    id: str
    x: float
    y: float
    yaw: float


def draw_false_positives(profile: DetectionProfile, seed: int, tick: int, eye_xy: Float, range_m: float) -> Objects:
    """Return false positives of car size within range_m of `at` (2,) [m]; each stands still for an epoch."""
    density = profile.false_positives / (math.pi * (FAR_M * FAR_M))
    low, high = ((eye_xy - range_m) // CELL_M).astype(int), ((eye_xy + range_m) // CELL_M).astype(int)
    ghosts: list[_FalsePositive] = []
    if density > 0.0:
        cells, (epoch, step) = _CellRange(*low.tolist(), *high.tolist()), divmod(tick, EPOCH_TICKS)
        ghosts += (one for one in _draw_in_cells(seed, density, cells, epoch) if step + one.phase < EPOCH_TICKS)
        ghosts += (one for one in _draw_in_cells(seed, density, cells, epoch + 1) if step + one.phase >= EPOCH_TICKS)
        ghosts = sorted(one for one in ghosts if portable.hypot(one.x - eye_xy[0], one.y - eye_xy[1]) <= range_m)
    x, y, yaw = np.array([(one.x, one.y, one.yaw) for one in ghosts]).reshape(-1, 3).T
    nothing = np.zeros(len(ghosts))
    return Objects(
        ids=tuple(one.id for one in ghosts),
        kind=np.full(len(ghosts), Kind.VEHICLE, dtype=np.uint8),
        x=x,
        y=y,
        yaw=yaw,
        speed=nothing,
        length=nothing + CAR_M[0],
        width=nothing + CAR_M[1],
    )


@lru_cache(maxsize=256)
def _draw_in_cells(seed: int, density: float, cells: _CellRange, epoch: int) -> tuple[_FalsePositive, ...]:
    """Return the false positives of all these cells in an epoch, at most one a cell."""
    ghosts: list[_FalsePositive] = []
    for i in range(cells.first_i, cells.last_i + 1):
        for j in range(cells.first_j, cells.last_j + 1):
            cell = f"{i} {j}"
            if draw_first_uniform(seed, "ghost", cell, epoch) < density * (CELL_M * CELL_M):
                _, x, y, yaw, *_ = draw_uniforms(seed, "ghost", cell, epoch)
                place = (i + x) * CELL_M, (j + y) * CELL_M, (yaw - 0.5) * TAU
                ghosts.append(_FalsePositive(i, j, draw_phase(seed, cell), f"ghost {cell} {epoch}", *place))
    return tuple(ghosts)
