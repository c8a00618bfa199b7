"""Rank correlations of small samples, for many resamples at once (SciPy is no dependency of the library)."""

import numpy as np

from mdrive_sumo.core.geometry import Float

DECIMALS = 9
"""Values that differ by less are ties: sums of the same numbers in another order differ in the last bits."""


def compute_spearman(x: Float, y: Float) -> Float:
    """Return Spearman's rho over the last axis of arrays (..., N); ties have their mean rank, NaN where all are tied.

    It is Pearson's correlation of the ranks (Spearman 1904), which equals SciPy's `spearmanr`.
    """
    ranks = [_compute_ranks(values) for values in (x, y)]
    first, second = (values - values.mean(axis=-1, keepdims=True) for values in ranks)
    return _divide((first * second).sum(axis=-1), (first**2).sum(axis=-1) * (second**2).sum(axis=-1))


def compute_kendall(x: Float, y: Float) -> Float:
    """Return Kendall's tau-b over the last axis of arrays (..., N), corrected for ties; NaN where all are tied.

    The difference of concordant and discordant pairs, divided by the geometric mean of the pairs that are not tied
    in each (Kendall 1945), which equals SciPy's `kendalltau`.
    """
    first, second = (_compare_pairs(values) for values in (x, y))
    return _divide((first * second).sum(axis=-1), np.abs(first).sum(axis=-1) * np.abs(second).sum(axis=-1))


def _compute_ranks(values: Float) -> Float:
    """Return the ranks (..., N) from 1 to N; equal values have the mean of their ranks."""
    rounded = values.round(DECIMALS)
    less = (rounded[..., None, :] < rounded[..., :, None]).sum(axis=-1)
    equal = (rounded[..., None, :] == rounded[..., :, None]).sum(axis=-1)
    return less + (equal + 1) / 2


def _compare_pairs(values: Float) -> Float:
    """Return -1, 0 or 1 for each pair (..., N (N - 1) / 2)."""
    rounded = values.round(DECIMALS)
    rows, columns = np.triu_indices(values.shape[-1], k=1)
    return np.sign(rounded[..., rows] - rounded[..., columns])


def _divide(covariance: Float, variances: Float) -> Float:
    """Return the quotient of a covariance and the root of a product of variances; NaN where that is 0."""
    roots = np.sqrt(variances)
    return np.divide(covariance, roots, out=np.full_like(roots, np.nan), where=roots > 0)
