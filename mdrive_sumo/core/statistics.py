"""Means with percentile bootstrap confidence intervals (Efron 1979).

Every interval draws from the same seed, so the same values always give the same interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float

RESAMPLES = 10_000
CONFIDENCE = 0.95
SEED = 0
CHUNK = 100
"""Resamples of a two-stage bootstrap that are in memory at once; RESAMPLES is a multiple."""


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    """A mean and the bounds of its confidence interval at level `CONFIDENCE`."""

    mean: float
    low: float
    high: float


def bootstrap_mean(values: Float) -> ConfidenceInterval:
    """Return the mean of values (N,), N >= 1, with its interval: the values, e.g. paired differences, are resampled.

    With one value per scenario, the interval says how the mean would vary over suites like this one.
    """
    return bootstrap_stratified_mean((values,))


def bootstrap_stratified_mean(groups: Sequence[Float]) -> ConfidenceInterval:
    """Return the mean of the means of the groups, (N,) each with N >= 1; every group is resampled on its own."""
    random = np.random.default_rng(SEED)
    means = [values[random.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1) for values in groups]
    return compute_percentile_interval(float(np.mean([values.mean() for values in groups])), np.mean(means, axis=0))


def bootstrap_clustered_mean(values: Float) -> ConfidenceInterval:
    """Return the mean of values (scenarios, seeds) with its interval: resamples scenarios, then seeds within each.

    Both stages are needed because the seeds of one scenario are not independent. With one seed it is `bootstrap_mean`.
    """
    if values.shape[1] == 1:
        return bootstrap_mean(values[:, 0])
    return bootstrap_stratified_clustered_mean((values,))


def bootstrap_stratified_clustered_mean(groups: Sequence[Float]) -> ConfidenceInterval:
    """Return the mean of the means of the groups, (scenarios, seeds) each; every group is resampled on its own.

    Within a group it resamples as `bootstrap_clustered_mean`.
    """
    random = np.random.default_rng(SEED)
    means = [
        np.concatenate([_resample_clusters(values, random) for _ in range(RESAMPLES // CHUNK)]) for values in groups
    ]
    return compute_percentile_interval(float(np.mean([values.mean() for values in groups])), np.mean(means, axis=0))


def _resample_clusters(values: Float, random: np.random.Generator) -> Float:
    """Return (CHUNK,) means of values (scenarios, seeds) resampled in both dimensions."""
    scenarios, seeds = values.shape
    rows = random.integers(scenarios, size=(CHUNK, scenarios, 1))
    columns = random.integers(seeds, size=(CHUNK, scenarios, seeds))
    return values[rows, columns].mean(axis=(1, 2))


def draw_resample_counts(size: int) -> Float:
    """Return how often each of `size` values counts (1 + RESAMPLES, size), for statistics that are no mean.

    The first row is the sample itself, where each counts once; the others are resamples.
    """
    drawn = np.random.default_rng(SEED).multinomial(size, np.full(size, 1 / size), size=RESAMPLES)
    return np.concatenate((np.ones((1, size)), drawn.astype(np.float64)))


def compute_percentile_interval(mean: float, resampled_means: Float) -> ConfidenceInterval:
    """Return the interval of a statistic from its values in resamples (R,)."""
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled_means, (tail, 1 - tail))
    return ConfidenceInterval(mean, float(low), float(high))
