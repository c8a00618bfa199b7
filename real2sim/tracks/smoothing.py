"""Penalised least squares on a time grid, for many tracks at once.

Whittaker's smoother (Eilers, A perfect smoother, Anal. Chem. 2003) with third differences minimises

sum of w_k |p_k - z_k|² + c_k |third difference|² + b_k |second difference|² + g_k |first difference|²

that is, the distance from the log against jerk and acceleration; the penalties g hold an object still between two
frames. The matrix has three diagonals on each side; its Cholesky factor is computed frame by frame, for all tracks in
one sweep.
"""

import numpy as np

from mdrive_sumo.core.geometry import Float

THIRD = np.array((-1.0, 3.0, -3.0, 1.0))
"""Third difference of four frames."""
BAND = 3
"""Number of diagonals on each side of the matrix: a third difference couples four frames."""


SECOND = np.array((1.0, -2.0, 1.0))
FIRST = np.array((-1.0, 1.0))


def smooth_positions(values: Float, weights: Float, *penalties: Float) -> Float:
    """Return the positions (K, T, D) that minimise the sum above; T >= 4.

    values (K, T, D), weights (K, T) >= 0 with at least three positive ones per track; penalties in any order: of third
    differences (K, T-3) > 0, of second ones (K, T-2) >= 0, of first ones (K, T-1) >= 0.
    """
    diagonals = _build_normal_matrix(weights, penalties)
    factor = _factorise(diagonals)
    return _solve(factor, weights[..., None] * values)


def _build_normal_matrix(weights: Float, penalties: tuple[Float, ...]) -> Float:
    """Return the lower diagonals (BAND + 1, K, T) of the normal matrix: [d, :, k] couples frames k and k - d."""
    tracks, frames = weights.shape
    matrix = np.zeros((BAND + 1, tracks, frames))
    matrix[0] = weights
    for penalty in penalties:
        terms = penalty.shape[1]
        kernel = {1: FIRST, 2: SECOND, 3: THIRD}[frames - terms]
        for i in range(len(kernel)):
            for j in range(i + 1):
                matrix[i - j, :, i : terms + i] += (kernel[i] * kernel[j]) * penalty
    return matrix


def _factorise(matrix: Float) -> Float:
    """Return the Cholesky factor as (T, BAND + 1, K): [k, d] couples frames k and k - d; [k, 0] is the inverse of its
    diagonal."""
    rows = np.ascontiguousarray(np.moveaxis(matrix, -1, 0))
    for k in range(len(rows)):
        for d in range(min(BAND, k), 0, -1):
            for e in range(d + 1, min(BAND, k) + 1):
                rows[k, d] -= rows[k, e] * rows[k - d, e - d]
            rows[k, d] *= rows[k - d, 0]
        rows[k, 0] -= (rows[k, 1 : min(BAND, k) + 1] ** 2).sum(axis=0)
        rows[k, 0] = 1.0 / np.sqrt(np.maximum(rows[k, 0], 1e-12))
    return rows


def _solve(factor: Float, right: Float) -> Float:
    """Solve for right-hand sides (K, T, D) by forward and backward substitution."""
    z = np.ascontiguousarray(np.moveaxis(right, 1, 0))
    frames = len(z)
    for k in range(frames):
        for d in range(1, min(BAND, k) + 1):
            z[k] -= factor[k, d][:, None] * z[k - d]
        z[k] *= factor[k, 0][:, None]
    for k in range(frames - 1, -1, -1):
        for d in range(1, min(BAND, frames - 1 - k) + 1):
            z[k] -= factor[k + d, d][:, None] * z[k + d]
        z[k] *= factor[k, 0][:, None]
    return np.moveaxis(z, 0, 1)
