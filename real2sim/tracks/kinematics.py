"""Kinematics of a trajectory at a fixed frame rate: steps, derivatives, jumps, yaw changes.

Third differences of positions at 10 Hz amplify noise too much: 1 cm of noise gives 45 m/s³. Every derivative here is
that of the cubic fitted by least squares to `WINDOW` frames (Savitzky, Golay 1964), taken at their middle. It is exact
for motion of constant jerk, and 1 cm of noise gives 4 m/s³. Jumps need no derivative and have their own check.
"""

from functools import lru_cache
from math import factorial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.core.geometry import Float, wrap_angles

WINDOW = 7
"""Frames of the fit: 0.6 s at 10 Hz."""
JUMP_WINDOW = 9
"""Number of steps whose median is the expected displacement per frame."""
TURN_SPEED = 2.0
"""[m/s] Below this speed the curvature of a path cannot be estimated from 10 Hz positions."""
TURN_OVER_M = 2.0
"""[m] Nearer to its ends the direction of a path is that of noise."""


def find_runs(valid: np.ndarray) -> list[slice]:
    """Return the stretches of consecutive valid frames as slices of `valid` (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(((0,), np.asarray(valid, dtype=np.int8), (0,)))))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def compute_derivative(values: Float, dt_s: float, order: int) -> Float:
    """Return the derivative of order 1 to 3 [unit/s^order] of values (N,) or (N, D): shape (max(N - 6, 0), ...), one
    row per full window."""
    if len(values) < WINDOW:
        return np.zeros((0, *values.shape[1:]))
    return sliding_window_view(values, WINDOW, axis=0) @ _build_kernel(dt_s, order)


@lru_cache(maxsize=32)
def _build_kernel(dt_s: float, order: int) -> Float:
    """Return the weights (`WINDOW`,) of the frames in a derivative."""
    offsets = np.arange(WINDOW) - WINDOW // 2
    return np.linalg.pinv(np.vander(offsets, 4, increasing=True))[order] * factorial(order) / dt_s**order


def magnitude(values: Float) -> Float:
    """Return the Euclidean length of the rows of (N, 2)."""
    return np.hypot(values[:, 0], values[:, 1])


def step_lengths(xy: Float) -> Float:
    """Return the distances (N-1,) [m] between consecutive rows of xy (N, 2)."""
    return magnitude(np.diff(xy, axis=0))


def jump_distances(xy: Float) -> Float:
    """Return how far each step (N-1,) [m] deviates from the median step around it, which motion does not explain.

    A car at 30 m/s moves 3 m per frame without jumping; braking with 8 m/s² deviates from the median by at most 0.4 m.
    """
    moved = np.diff(xy, axis=0)
    half = JUMP_WINDOW // 2
    if len(moved) == 0:
        return np.zeros(0)
    padded = np.pad(moved, ((half, half), (0, 0)), constant_values=np.nan)
    ordered = np.sort(sliding_window_view(padded, JUMP_WINDOW, axis=0), axis=-1)  # NaN last
    last = np.isfinite(ordered).sum(axis=-1, keepdims=True) - 1
    middle = [np.take_along_axis(ordered, place, axis=-1)[..., 0] for place in (last // 2, (last + 1) // 2)]
    usual = (middle[0] + middle[1]) / 2
    return magnitude(moved - usual)


def acceleration_magnitudes(xy: Float, dt_s: float) -> Float:
    """Return the magnitude of the acceleration vector [m/s²], longitudinal and lateral together."""
    return magnitude(compute_derivative(xy, dt_s, 2))


def jerk_magnitudes(xy: Float, dt_s: float) -> Float:
    """Return the magnitude of the jerk vector [m/s³], longitudinal and lateral together."""
    return magnitude(compute_derivative(xy, dt_s, 3))


def yaw_steps(yaw: Float) -> Float:
    """Return the absolute change of yaw [rad] from frame to frame."""
    return np.abs(wrap_angles(np.diff(yaw)))


def max_yaw_change(yaw: Float, frames: int) -> float:
    """Return the largest change of the unwrapped yaw [rad] within `frames` frames; it can exceed pi."""
    turned = np.unwrap(yaw)
    if len(turned) < 2:
        return 0.0
    windows = sliding_window_view(turned, min(frames + 1, len(turned)))
    return float((windows.max(-1) - windows.min(-1)).max())


def backward_distances(xy: Float, yaw: Float) -> Float:
    """Return how far each step (N-1,) [m] goes against the heading of the box; 0 for forward steps."""
    moved = np.diff(xy, axis=0)
    return np.maximum(-(moved[:, 0] * np.cos(yaw[:-1]) + moved[:, 1] * np.sin(yaw[:-1])), 0.0)


def curvature_changes(xy: Float, dt_s: float) -> Float:
    """Return the frame-to-frame changes of the path's curvature [1/m] where the speed exceeds `TURN_SPEED`."""
    velocity, acceleration = compute_derivative(xy, dt_s, 1), compute_derivative(xy, dt_s, 2)
    speed = magnitude(velocity)
    cross = velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]
    curvature = np.where(speed > TURN_SPEED, cross / np.maximum(speed, TURN_SPEED) ** 3, np.nan)
    changes = np.diff(curvature)
    return changes[np.isfinite(changes)]


def compute_turn(xy: Float) -> float:
    """Return the change of direction [rad] between leaving the first position by `TURN_OVER_M` and coming that near to
    the last; 0 for a path that stays within it."""
    away, left = magnitude(xy - xy[0]) >= TURN_OVER_M, magnitude(xy - xy[-1]) >= TURN_OVER_M
    if not away.any() or not left.any():
        return 0.0
    begin, end = xy[int(away.argmax())] - xy[0], xy[-1] - xy[np.flatnonzero(left)[-1]]
    return float(wrap_angles(np.array(np.arctan2(end[1], end[0]) - np.arctan2(begin[1], begin[0]))))
