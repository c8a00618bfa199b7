"""Detection errors of a profile: misses and noise that last for about half a second.

All random numbers depend on (seed, object id, time) only, so that results depend neither on the order of objects nor
on the ticks in which a sensor runs.
"""

import math
from functools import lru_cache

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.seeding import UNIFORMS, draw_normals, draw_uniforms

EPOCH_TICKS = 10
"""0.5 s: duration of a miss, and time scale of position errors."""
WEIGHTS = tuple(portable.cos_sin(math.pi / 2 * step / EPOCH_TICKS) for step in range(EPOCH_TICKS))
"""Of the earlier and the later draw, by the ticks since the earlier one."""


@lru_cache(maxsize=4096)
def draw_phase(seed: int, name: str) -> int:
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
    lucks = [_draw_miss(seed, name, (tick + draw_phase(seed, name)) // EPOCH_TICKS) for name in ids]
    return np.array(lucks, dtype=np.float64) < recall


def add_errors(profile: DetectionProfile, seed: int, tick: int, truth: Objects, eye_xy: Float) -> Objects:
    """Return the objects, by true ids, with noise; `at` (2,) [m] is the sensor position."""
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
    if not ids:
        return np.empty((0, UNIFORMS))
    times = [divmod(tick + draw_phase(seed, name), EPOCH_TICKS) for name in ids]
    weights = np.array([WEIGHTS[step] for _, step in times])
    earlier = np.array([_draw_errors(seed, name, epoch) for name, (epoch, _) in zip(ids, times, strict=True)])
    later = np.array([_draw_errors(seed, name, epoch + 1) for name, (epoch, _) in zip(ids, times, strict=True)])
    return weights[:, :1] * earlier + weights[:, 1:] * later
