"""Detection errors of a profile: misses, noise, and cars that are not there, each for about half a second.

All random numbers depend on (seed, object id, time) only, so that results depend neither on the order of objects nor
on the ticks in which a sensor runs. False positives are drawn by the cells of a grid: a draw for all cells around a
sensor serves all ticks of the epoch.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import FAR_M, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float, wrap_angles
from mdrive_sumo.core.seeding import UNIFORMS, draw_first_uniform, draw_normals, draw_uniforms
from mdrive_sumo.core.state import Kind

EPOCH_TICKS = 10
"""0.5 s: duration of a miss, and time scale of position errors."""
WEIGHTS = tuple(portable.cos_sin(math.pi / 2 * step / EPOCH_TICKS) for step in range(EPOCH_TICKS))
"""Weights of the earlier and the later draw, by the ticks since the earlier one."""


def draw_phase(seed: int, name: str) -> int:
    """Return the offset of this object's epochs, so that objects do not appear and vanish all in the same tick."""
    return int(draw_first_uniform(seed, "phase", name) * EPOCH_TICKS)


def draw_detected(seed: int, tick: int, ids: tuple[str, ...], recall: Float) -> Bool:
    """Return an (N,) mask of the objects that are detected in this tick, for detection probabilities recall (N,)."""
    epochs = [(tick + draw_phase(seed, name)) // EPOCH_TICKS for name in ids]
    lucks = [draw_first_uniform(seed, "miss", name, epoch) for name, epoch in zip(ids, epochs, strict=True)]
    return np.array(lucks, dtype=np.float64) < recall


def add_errors(profile: DetectionProfile, seed: int, tick: int, truth: Objects, eye_xy: tuple[float, float]) -> Objects:
    """Return the objects, by true ids, with noise; eye_xy: the sensor position [m]."""
    noise = _interpolate_errors(seed, tick, truth.ids)
    x, y = truth.x - eye_xy[0], truth.y - eye_xy[1]
    distance = portable.hypot(x, y)
    spread, (cos, sin) = profile.spread_at(distance), portable.cos_sin(portable.atan2(y, x))
    along, across = spread * noise[:, 0], spread * noise[:, 1]
    scale = portable.exp(profile.size_sigma * noise[:, 4:6])
    return Objects(
        ids=truth.ids,
        kind=truth.kind,
        x=truth.x + along * cos - across * sin,
        y=truth.y + along * sin + across * cos,
        yaw=wrap_angles(truth.yaw + profile.yaw_sigma * noise[:, 2]),
        speed=truth.speed + profile.speed_sigma * noise[:, 3],
        length=truth.length * scale[:, 0],
        width=truth.width * scale[:, 1],
    )


def _interpolate_errors(seed: int, tick: int, ids: tuple[str, ...]) -> Float:
    """Return (N, 8) standard normal errors that vary smoothly: weights of two consecutive draws keep the variance."""
    errors = np.empty((len(ids), UNIFORMS))
    for row, name in zip(errors, ids, strict=True):
        epoch, step = divmod(tick + draw_phase(seed, name), EPOCH_TICKS)
        earlier, later = (np.array(draw_normals(seed, "error", name, one)) for one in (epoch, epoch + 1))
        row[:] = WEIGHTS[step][0] * earlier + WEIGHTS[step][1] * later
    return errors


CELL_M = 50.0
"""Edge of the grid cells for which false positives are drawn."""
CAR_M = (4.5, 1.9)
"""Length and width of a false positive."""


class FalsePositive(NamedTuple):
    """A car that is not there, of a cell (i, j). The epochs of the cell begin `phase` ticks before those of phase 0."""

    i: int
    j: int
    phase: int
    id: str
    x: float
    y: float
    yaw: float


def draw_false_positives(
    profile: DetectionProfile, seed: int, tick: int, eye_xy: tuple[float, float], range_m: float
) -> list[FalsePositive]:
    """Return false positives within range_m of the sensor position [m], by cells; each stands still for an epoch."""
    if not profile.false_positives:
        return []
    density, (x, y) = profile.false_positives / (math.pi * (FAR_M * FAR_M)), eye_xy
    low = int((x - range_m) // CELL_M), int((y - range_m) // CELL_M)
    high = int((x + range_m) // CELL_M), int((y + range_m) // CELL_M)
    epoch, step = divmod(tick, EPOCH_TICKS)
    ghosts = [one for one in _draw_in_cells(seed, density, low, high, epoch) if step + one.phase < EPOCH_TICKS]
    ghosts += [one for one in _draw_in_cells(seed, density, low, high, epoch + 1) if step + one.phase >= EPOCH_TICKS]
    return sorted([one for one in ghosts if portable.hypot(one.x - x, one.y - y) <= range_m])


def build_false_positives(ghosts: Iterable[FalsePositive]) -> Objects:
    """Return false positives as objects of car size that stand still."""
    ghosts = tuple(ghosts)
    x, y, yaw = np.array([(one.x, one.y, one.yaw) for one in ghosts], dtype=np.float64).reshape(-1, 3).T
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
def _draw_in_cells(
    seed: int, density: float, low: tuple[int, int], high: tuple[int, int], epoch: int
) -> tuple[FalsePositive, ...]:
    """Return the false positives of all cells from low to high in an epoch, at most one a cell."""
    ghosts: list[FalsePositive] = []
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            cell = f"{i} {j}"
            if draw_first_uniform(seed, "ghost", cell, epoch) < density * (CELL_M * CELL_M):
                _, x, y, yaw, *_ = draw_uniforms(seed, "ghost", cell, epoch)
                place = (i + x) * CELL_M, (j + y) * CELL_M, (yaw - 0.5) * TAU
                ghosts.append(FalsePositive(i, j, draw_phase(seed, cell), f"ghost {cell} {epoch}", *place))
    return tuple(ghosts)
