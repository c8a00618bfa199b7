"""The trajectory nearest to a log with bounded jerk and acceleration, as the solution of a convex problem.

minimise sum of |p_k - z_k|² with |jerk| <= j, |acceleration| <= a, standing steps = 0, no step backward

Solved by the alternating direction method of multipliers (Boyd et al. 2011, section 5), one track at a time, with dense
matrices: meant for the tracks that are still implausible after smoothing (`smoothing` handles all tracks at once).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float
from real2sim.tracks.kinematics import WINDOW, compute_derivative

MAX_ITERATIONS, CHECK_INTERVAL = 400, 10
"""Maximum number of iterations, and the number of iterations between two convergence checks."""
RELATIVE_TOLERANCE = 0.01
"""Convergence: bounds hold to this share of them, steps to this share of `STEP_UNIT_M`."""
STEP_UNIT_M = 0.1
"""[m] Unit of the steps, as jerk and acceleration are in units of their bounds."""
RELAXATION = 1.7
"""Over-relaxation; 1.5 to 1.8 converges fastest (Boyd et al., section 3.4.3)."""
PENALTIES = (3000.0, 300.0, 30.0)
"""Penalty parameters of the method for jerk, acceleration and steps: they affect the rate of convergence, not the
result."""
SMOOTHNESS = 0.3
"""Penalty of third differences, for oscillations that the window of the derivatives does not cover."""


@dataclass(frozen=True)
class TrajectoryBounds:
    """Bounds of a trajectory of T frames."""

    jerk: float
    """Largest jerk [m/s³] at any frame."""
    acceleration: float
    """Largest acceleration [m/s²] at any frame."""
    still: Bool
    """(T-1,) steps without motion."""
    heading: Float | None = None
    """(T-1,) [rad] steps must not point against it; None: no restriction."""


def fit_bounded_trajectory(xy: Float, bounds: TrajectoryBounds, dt_s: float) -> Float:
    """Return the positions (T, 2) [m] nearest to xy (T, 2) [m] within the bounds; unchanged if T <= 7."""
    frames = len(xy)
    if frames <= WINDOW:
        return xy
    if bounds.heading is None:
        ahead = np.zeros((2, frames - 1))
    else:
        ahead = np.stack((np.cos(bounds.heading), np.sin(bounds.heading)))
    matrices = _build_matrices(frames, bounds.jerk, bounds.acceleration, dt_s)
    return _solve(np.ascontiguousarray(xy.T), *matrices, ahead, bounds.still).T


@twin
def _solve(wanted: Float, rows: Float, inverse: Float, pull: Float, ahead: Float, still: Bool, /) -> Float:
    """Return the positions (2, T) nearest to the wanted ones (2, T).

    rows (N, T), inverse (T, T), pull (T, N): see `_build_matrices`. ahead (2, T-1): directions of steps, 0: any; still
    (T-1,).
    """
    steps = len(rows) - len(still)
    free, p = _multiply(inverse, wanted), wanted
    y = _project(_multiply(rows, p), steps, ahead, still)
    u = np.zeros_like(y)
    for k in range(MAX_ITERATIONS):
        p = free + _multiply(pull, y - u)
        true = _multiply(rows, p)
        if k % CHECK_INTERVAL == CHECK_INTERVAL - 1 and np.abs(true - y).max() < RELATIVE_TOLERANCE:
            break
        now = RELAXATION * true + (1 - RELAXATION) * y
        y = _project(now + u, steps, ahead, still)
        u = u + now - y
    return p


@lru_cache(maxsize=32)
def _build_matrices(frames: int, jerk: float, acceleration: float, dt_s: float) -> tuple[Float, Float, Float]:
    """Return the constrained quantities (N, T) in units of their bounds (jerk, acceleration, steps), and the matrices
    of one iteration."""
    unit = np.eye(frames)
    blocks = [compute_derivative(unit, dt_s, order) / limit for order, limit in ((3, jerk), (2, acceleration))]
    blocks.append(np.diff(unit, axis=0) / STEP_UNIT_M)
    most = [float(np.abs(block).sum(axis=1).max()) ** 2 for block in blocks]
    rows = np.concatenate(blocks)
    scale = np.repeat([gain / size for gain, size in zip(PENALTIES, most, strict=True)], [len(b) for b in blocks])
    third = np.diff(unit, n=3, axis=0)
    inverse = np.asarray(
        np.linalg.inv(unit + SMOOTHNESS * third.T @ third + rows.T @ (scale[:, None] * rows)), dtype=np.float64
    )
    return rows, inverse, inverse @ (rows.T * scale)


def _multiply(matrix: Float, vectors: Float) -> Float:
    """Multiply matrix (M, N) with vectors (2, N): (2, M).

    The terms of even and of odd columns are summed apart, pairs of columns from the last to the first in each eight: as
    NumPy's einsum sums two numbers at a time.
    """
    columns = matrix.shape[1]
    whole = columns // 8 * 8
    even = [*(first + k for first in range(0, whole, 8) for k in (6, 4, 2, 0)), *range(whole, columns, 2)]
    odd = [k + 1 for k in even if k + 1 < columns]
    terms = matrix * vectors[:, None]
    return np.cumsum(terms[..., even], axis=-1)[..., -1] + np.cumsum(terms[..., odd], axis=-1)[..., -1]


def _project(values: Float, steps: int, ahead: Float, still: Bool) -> Float:
    """Project columns (2, N) onto the feasible set: length at most 1; from column `steps` on, no component backward."""
    size = np.hypot(values[0], values[1])
    size[steps:] = 1.0
    result = values / np.maximum(size, 1.0)
    step = result[:, steps:]
    backward = np.minimum(step[0] * ahead[0] + step[1] * ahead[1], 0.0)
    result[:, steps:] = np.where(still, 0.0, step - backward * ahead)
    return result
