"""How a trajectory moves: steps, derivatives, jumps, yaw. Pure functions over positions at a fixed frame rate.

Positions at 10 Hz cannot be differenced three times plainly: 1 cm of noise alone gives 45 m/s³. Every derivative here
is that of the cubic fitted by least squares to `WINDOW` frames (Savitzky, Golay 1964), taken at their middle. It is
exact for motion of constant jerk, and 1 cm of noise gives 4 m/s³. Jumps need no derivative and have their own check.
"""

from math import factorial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.core.geometry import Float, wrap_angles

WINDOW = 7
"""Frames of the fit: 0.6 s at 10 Hz."""
JUMP_WINDOW = 9
"""Steps whose median tells how far a thing should have gone in one frame."""
TURN_SPEED = 2.0
"""[m/s] Below this the curvature of a path cannot be told from 10 Hz positions."""


def find_runs(valid: np.ndarray) -> list[slice]:
    """Stretches of consecutive frames that are there: slices of the rows of `valid` (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(((0,), np.asarray(valid, dtype=np.int8), (0,)))))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def compute_derivative(values: Float, dt_s: float, order: int) -> Float:
    """Derivative of values (N,) or (N, D) [unit/s^order], order 1 to 3: (max(N - 6, 0), ...), one row a full window."""
    if len(values) < WINDOW:
        return np.zeros((0, *values.shape[1:]))
    offsets = np.arange(WINDOW) - WINDOW // 2
    kernel = np.linalg.pinv(np.vander(offsets, 4, increasing=True))[order] * factorial(order) / dt_s**order
    return sliding_window_view(values, WINDOW, axis=0) @ kernel


def magnitude(values: Float) -> Float:
    """Euclidean length of the rows of (N, 2)."""
    return np.hypot(values[:, 0], values[:, 1])


def step_lengths(xy: Float) -> Float:
    """Distance [m] between consecutive rows of xy (N, 2): (N-1,)."""
    return magnitude(np.diff(xy, axis=0))


def jump_distances(xy: Float) -> Float:
    """How far each step (N-1,) [m] lies off the median step around it: what motion does not explain.

    A car at 30 m/s moves 3 m a frame without jumping; braking with 8 m/s² it is off the median by at most 0.4 m.
    """
    moved = np.diff(xy, axis=0)
    half = JUMP_WINDOW // 2
    if len(moved) == 0:
        return np.zeros(0)
    padded = np.pad(moved, ((half, half), (0, 0)), constant_values=np.nan)
    usual = np.nanmedian(sliding_window_view(padded, JUMP_WINDOW, axis=0), axis=-1)
    return magnitude(moved - usual)


def acceleration_magnitudes(xy: Float, dt_s: float) -> Float:
    """Length of the acceleration vector [m/s²], along and across."""
    return magnitude(compute_derivative(xy, dt_s, 2))


def jerk_magnitudes(xy: Float, dt_s: float) -> Float:
    """Length of the jerk vector [m/s³], along and across."""
    return magnitude(compute_derivative(xy, dt_s, 3))


def yaw_steps(yaw: Float) -> Float:
    """Absolute change of yaw from frame to frame [rad]."""
    return np.abs(wrap_angles(np.diff(yaw)))


def max_yaw_change(yaw: Float, frames: int) -> float:
    """Largest absolute change of yaw [rad] over `frames` frames, turned ones included (more than pi is possible)."""
    turned = np.unwrap(yaw)
    if len(turned) < 2:
        return 0.0
    windows = sliding_window_view(turned, min(frames + 1, len(turned)))
    return float((windows.max(-1) - windows.min(-1)).max())


def backward_distances(xy: Float, yaw: Float) -> Float:
    """How far each step (N-1,) [m] goes against the heading of the box; 0 where it goes forward."""
    moved = np.diff(xy, axis=0)
    return np.maximum(-(moved[:, 0] * np.cos(yaw[:-1]) + moved[:, 1] * np.sin(yaw[:-1])), 0.0)


def curvature_changes(xy: Float, dt_s: float) -> Float:
    """Change of the path's curvature from frame to frame [1/m] where it is faster than `TURN_SPEED`."""
    velocity, acceleration = compute_derivative(xy, dt_s, 1), compute_derivative(xy, dt_s, 2)
    speed = magnitude(velocity)
    cross = velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]
    curvature = np.where(speed > TURN_SPEED, cross / np.maximum(speed, TURN_SPEED) ** 3, np.nan)
    changes = np.diff(curvature)
    return changes[np.isfinite(changes)]


def compute_turn(xy: Float, least_m: float = 2.0) -> float:
    """Change of direction [rad] from leaving the first place by `least_m` to coming that near to the last; else 0."""
    away, left = magnitude(xy - xy[0]) >= least_m, magnitude(xy - xy[-1]) >= least_m
    if not away.any() or not left.any():
        return 0.0
    begin, end = xy[int(away.argmax())] - xy[0], xy[-1] - xy[np.flatnonzero(left)[-1]]
    return float(wrap_angles(np.array(np.arctan2(end[1], end[0]) - np.arctan2(begin[1], begin[0]))))
