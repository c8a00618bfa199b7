"""The trajectory nearest to a log whose jerk and acceleration stay within bounds, exactly: a convex problem.

    minimise  sum of |p_k - z_k|²   with  |jerk| <= j,  |acceleration| <= a,  steps that stand = 0,  none backward

Solved by the alternating direction method of multipliers (Boyd et al. 2011, section 5), one track at a time, with dense
matrices: meant for the tracks that are not plausible once noise is gone (`smoothing` is for all at once).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from real2sim.tracks.kinematics import WINDOW, compute_derivative

ITERATIONS, CHECKED = 400, 10
"""At most so many steps; after every `CHECKED` it is seen whether the bounds hold."""
HOLDS = 0.01
"""... to this share of them, and steps to this share of `STEP_M`."""
STEP_M = 0.1
RELAXED = 1.7
"""Over-relaxation: 1.5 to 1.8 converges soonest (Boyd et al., section 3.4.3)."""
STRENGTHS = (3000.0, 300.0, 30.0)
"""Penalties of the method for jerk, acceleration and steps: they decide how soon it converges, not where to."""
SOFT = 0.3
"""Penalty of third differences, for what the window of the derivatives does not see."""


@dataclass(frozen=True)
class TrajectoryBounds:
    """What a trajectory of T frames may do."""

    jerk: float
    """[m/s³]"""
    acceleration: float
    """[m/s²]"""
    still: Bool
    """(T-1,) steps at which it stands."""
    heading: Float | None = None
    """(T-1,) [rad] steps do not go against it; None: they may go anywhere."""


def fit_bounded_trajectory(xy: Float, bounds: TrajectoryBounds, dt_s: float) -> Float:
    """Positions (T, 2) [m] nearest to xy (T, 2) [m] within the bounds; T > 7, else as they are."""
    frames = len(xy)
    if frames <= WINDOW:
        return xy
    rows, inverse, pull = _matrices(frames, bounds.jerk, bounds.acceleration, dt_s)
    steps = len(rows) - (frames - 1)
    free, p = _product(inverse, xy.T), xy.T
    y = _allowed(_product(rows, p), steps, bounds)
    u = np.zeros_like(y)
    for k in range(ITERATIONS):
        p = free + _product(pull, y - u)
        true = _product(rows, p)
        if k % CHECKED == CHECKED - 1 and np.abs(true - y).max() < HOLDS:
            break
        now = RELAXED * true + (1 - RELAXED) * y
        y = _allowed(now + u, steps, bounds)
        u = u + now - y
    return p.T


@lru_cache(maxsize=32)
def _matrices(frames: int, jerk: float, acceleration: float, dt_s: float) -> tuple[Float, Float, Float]:
    """What is bounded (N, T), in units of its bounds: jerk, acceleration, steps; and what one step solves with."""
    unit = np.eye(frames)
    blocks = [compute_derivative(unit, dt_s, order) / limit for order, limit in ((3, jerk), (2, acceleration))]
    blocks.append(np.diff(unit, axis=0) / STEP_M)
    most = [float(np.abs(block).sum(axis=1).max()) ** 2 for block in blocks]
    rows = np.concatenate(blocks)
    scale = np.repeat([gain / size for gain, size in zip(STRENGTHS, most, strict=True)], [len(b) for b in blocks])
    third = np.diff(unit, n=3, axis=0)
    inverse = np.asarray(
        np.linalg.inv(unit + SOFT * third.T @ third + rows.T @ (scale[:, None] * rows)), dtype=np.float64
    )
    return rows, inverse, inverse @ (rows.T * scale)


def _product(matrix: Float, vectors: Float) -> Float:
    """Matrix (M, N) times vectors (2, N): (2, M). On one core: threads only wait for each other at this size."""
    return np.einsum("ij,kj->ki", matrix, np.ascontiguousarray(vectors))


def _allowed(values: Float, steps: int, bounds: TrajectoryBounds) -> Float:
    """Columns (2, N) moved to the nearest that is allowed: lengths up to 1, but from column `steps` on no way back."""
    size = np.hypot(values[0], values[1])
    size[steps:] = 1.0
    result = values / np.maximum(size, 1.0)
    step = result[:, steps:]
    if bounds.heading is not None:
        ahead = np.stack((np.cos(bounds.heading), np.sin(bounds.heading)))
        step = step - np.minimum((step * ahead).sum(axis=0), 0.0) * ahead
    result[:, steps:] = np.where(bounds.still, 0.0, step)
    return result
