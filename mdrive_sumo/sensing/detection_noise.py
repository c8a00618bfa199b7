"""Detection errors of a profile: misses, noise and false positives that last for about half a second.

All random numbers depend on (seed, object id, time) only, so that results depend neither on the order of objects nor
on the ticks in which a sensor runs.
"""

import math
from functools import lru_cache

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import FAR_M, DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float, wrap_angles
from mdrive_sumo.core.seeding import UNIFORMS, draw_normals, draw_uniforms
from mdrive_sumo.core.state import Kind

EPOCH_TICKS = 10
"""0.5 s: duration of a miss, and time scale of position errors."""
CELL_M = 50.0
"""Edge of the grid cells for which false positives are drawn."""
CAR_M = (4.5, 1.9)
"""Length and width of a false positive."""
WEIGHTS = tuple(portable.cos_sin(math.pi / 2 * step / EPOCH_TICKS) for step in range(EPOCH_TICKS))
"""Of the earlier and the later draw, by the ticks since the earlier one."""


@lru_cache(maxsize=4096)
def _phase(seed: int, name: str) -> int:
    """Return the offset of this object's epochs, so that objects do not appear and vanish all in the same tick."""
    return int(draw_uniforms(seed, "phase", name)[0] * EPOCH_TICKS)


@lru_cache(maxsize=4096)
def _draw_miss(seed: int, name: str, epoch: int) -> float:
    return draw_uniforms(seed, "miss", name, epoch)[0]


@lru_cache(maxsize=4096)
def _draw_errors(seed: int, name: str, epoch: int) -> Float:
    return np.array(draw_normals(seed, "error", name, epoch))


def draw_detected(seed: int, tick: int, ids: tuple[str, ...], recall: Float) -> Bool:
    """Return an (N,) mask of the objects that are detected in this tick, for detection probabilities recall (N,)."""
    lucks = [_draw_miss(seed, name, (tick + _phase(seed, name)) // EPOCH_TICKS) for name in ids]
    return np.array(lucks, dtype=np.float64) < recall


def add_errors(profile: DetectionProfile, seed: int, tick: int, truth: Objects, at: Float) -> Objects:
    """Return the objects, by true ids, with noise; `at` (2,) [m] is the sensor position."""
    noise = _interpolate_errors(seed, tick, truth.ids)
    x, y = truth.x - at[0], truth.y - at[1]
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
    if not ids:
        return np.empty((0, UNIFORMS))
    times = [divmod(tick + _phase(seed, name), EPOCH_TICKS) for name in ids]
    weights = np.array([WEIGHTS[step] for _, step in times])
    earlier = np.array([_draw_errors(seed, name, epoch) for name, (epoch, _) in zip(ids, times, strict=True)])
    later = np.array([_draw_errors(seed, name, epoch + 1) for name, (epoch, _) in zip(ids, times, strict=True)])
    return weights[:, :1] * earlier + weights[:, 1:] * later


def draw_false_positives(profile: DetectionProfile, seed: int, tick: int, at: Float, range_m: float) -> Objects:
    """Return false positives of car size within range_m of `at` (2,) [m]; each stands still for an epoch."""
    density = profile.false_positives / (math.pi * (FAR_M * FAR_M))
    low, high = ((at - range_m) // CELL_M).astype(int), ((at + range_m) // CELL_M).astype(int)
    rows: list[tuple[str, float, float, float]] = []
    if density > 0.0:
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                rows += _draw_in_cell(seed, tick, i, j, density)
    rows = [row for row in rows if portable.hypot(row[1] - at[0], row[2] - at[1]) <= range_m]
    x, y, yaw = np.array([row[1:] for row in rows]).reshape(-1, 3).T
    nothing = np.zeros(len(rows))
    return Objects(
        ids=tuple(row[0] for row in rows),
        kind=np.full(len(rows), Kind.VEHICLE, dtype=np.uint8),
        x=x,
        y=y,
        yaw=yaw,
        speed=nothing,
        length=nothing + CAR_M[0],
        width=nothing + CAR_M[1],
    )


def _draw_in_cell(seed: int, tick: int, i: int, j: int, density: float) -> list[tuple[str, float, float, float]]:
    """Return at most one false positive of a cell: id, x, y and yaw."""
    cell = f"{i} {j}"
    epoch = (tick + _phase(seed, cell)) // EPOCH_TICKS
    return _draw_false_positive(seed, cell, epoch, i, j, density)


@lru_cache(maxsize=4096)
def _draw_false_positive(
    seed: int, cell: str, epoch: int, i: int, j: int, density: float
) -> list[tuple[str, float, float, float]]:
    luck, x, y, yaw, *_ = draw_uniforms(seed, "ghost", cell, epoch)
    if luck >= density * (CELL_M * CELL_M):
        return []
    return [(f"ghost {cell} {epoch}", (i + x) * CELL_M, (j + y) * CELL_M, (yaw - 0.5) * TAU)]
