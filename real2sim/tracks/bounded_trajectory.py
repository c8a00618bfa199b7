"""The trajectory nearest to a log with bounded jerk and acceleration, as the solution of a convex problem.

minimise sum of |p_k - z_k|² with |jerk| <= j, |acceleration| <= a, standing steps = 0, no step backward

Solved by the alternating direction method of multipliers (Boyd et al. 2011, section 5), one track at a time, with dense
matrices: meant for the tracks that are still implausible after smoothing (`smoothing` handles all tracks at once).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
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
    rows, inverse, pull = _build_matrices(frames, bounds.jerk, bounds.acceleration, dt_s)
    feasible = _FeasibleSet.from_bounds(bounds, len(rows) - (frames - 1))
    start = np.ascontiguousarray(xy.T)
    free, p = _multiply(inverse, start), start
    y = feasible.project(_multiply(rows, p))
    u = np.zeros_like(y)
    for k in range(MAX_ITERATIONS):
        p = free + _multiply(pull, y - u)
        true = _multiply(rows, p)
        if k % CHECK_INTERVAL == CHECK_INTERVAL - 1 and np.abs(true - y).max() < RELATIVE_TOLERANCE:
            break
        now = RELAXATION * true + (1 - RELAXATION) * y
        y = feasible.project(now + u)
        u = u + now - y
    return p.T


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
    """Multiply matrix (M, N) with contiguous vectors (2, N): (2, M). Single-threaded: at this size threads mostly wait
    for each other."""
    return np.einsum("ij,kj->ki", matrix, vectors)


@dataclass(frozen=True)
class _FeasibleSet:
    """Columns (2, N) of length at most 1; from column `steps` on, without a component backward, 0 where still."""

    steps: int
    ahead: tuple[Float, Float] | None
    """Cosine and sine of the heading; None: no restriction."""
    still: Int
    """Columns without motion."""

    @classmethod
    def from_bounds(cls, bounds: TrajectoryBounds, steps: int) -> "_FeasibleSet":
        ahead = None if bounds.heading is None else (np.cos(bounds.heading), np.sin(bounds.heading))
        return cls(steps, ahead, steps + np.flatnonzero(bounds.still))

    def project(self, values: Float) -> Float:
        """Return the nearest columns of the set."""
        limited, (x, y) = values[:, : self.steps], values[:, self.steps :]
        result = np.empty_like(values)
        np.divide(limited, np.maximum(np.hypot(limited[0], limited[1]), 1.0), out=result[:, : self.steps])
        if self.ahead is not None:
            cos, sin = self.ahead
            backward = np.minimum(x * cos + y * sin, 0.0)
            x, y = x - backward * cos, y - backward * sin
        result[0, self.steps :], result[1, self.steps :] = x, y
        if len(self.still):
            result[:, self.still] = 0.0
        return result
