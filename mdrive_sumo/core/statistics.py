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
    return make_interval(float(np.mean([values.mean() for values in groups])), _resample_stratified_mean(groups))


def bootstrap_clustered_mean(values: Float) -> ConfidenceInterval:
    """Return the mean of values (scenarios, seeds) with its interval: resamples scenarios, then seeds within each.

    Both stages are needed because the seeds of one scenario are not independent. With one seed it is `bootstrap_mean`.
    """
    return make_interval(float(values.mean()), resample_clustered_mean(values))


def bootstrap_stratified_clustered_mean(groups: Sequence[Float]) -> ConfidenceInterval:
    """Return the mean of the means of the groups, (scenarios, seeds) each; every group is resampled on its own.

    Within a group it resamples as `bootstrap_clustered_mean`.
    """
    resampled = resample_stratified_clustered_mean(groups)
    return make_interval(float(np.mean([values.mean() for values in groups])), resampled)


def resample_clustered_mean(values: Float) -> Float:
    """Return the (RESAMPLES,) means from which `bootstrap_clustered_mean` takes its interval.

    Values of one shape are drawn alike: the differences of two results are those of paired differences.
    """
    if values.shape[1] == 1:
        return _resample_stratified_mean((values[:, 0],))
    return resample_stratified_clustered_mean((values,))


def resample_stratified_clustered_mean(groups: Sequence[Float]) -> Float:
    """Return the (RESAMPLES,) means from which `bootstrap_stratified_clustered_mean` takes its interval.

    Groups of the same shapes are drawn alike, as by `resample_clustered_mean`.
    """
    random = np.random.default_rng(SEED)
    means = [
        np.concatenate([_resample_clusters(values, random) for _ in range(RESAMPLES // CHUNK)]) for values in groups
    ]
    return np.mean(means, axis=0)


def _resample_stratified_mean(groups: Sequence[Float]) -> Float:
    random = np.random.default_rng(SEED)
    means = [values[random.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1) for values in groups]
    return np.mean(means, axis=0)


def _resample_clusters(values: Float, random: np.random.Generator) -> Float:
    """Return (CHUNK,) means of values (scenarios, seeds) resampled in both dimensions."""
    scenarios, seeds = values.shape
    rows = random.integers(scenarios, size=(CHUNK, scenarios, 1))
    columns = random.integers(seeds, size=(CHUNK, scenarios, seeds))
    return values[rows, columns].mean(axis=(1, 2))


def draw_resample_counts(size: int) -> Float:
    """Return how often each of `size` values counts (1 + RESAMPLES, size), for statistics that are no mean.

    The first row is the sample itself, where each counts once; the others are the resamples of `bootstrap_mean`.
    """
    drawn = np.random.default_rng(SEED).integers(size, size=(RESAMPLES, size))
    places = drawn + size * np.arange(RESAMPLES)[:, np.newaxis]
    counts = np.bincount(places.ravel(), minlength=RESAMPLES * size).reshape(RESAMPLES, size)
    return np.concatenate((np.ones((1, size)), counts.astype(np.float64)))


def sum_resamples(counts: Float, values: Float) -> Float:
    """Return the sums (R, ...) of values (N, ...) where value j counts `counts[r, j]` times; no sum depends on R.

    It adds one value after the other, because a matrix product has other last bits on other machines.
    """
    sums = np.zeros((len(counts), *values.shape[1:]))
    for column, value in zip(counts.T, values, strict=True):
        sums += np.multiply.outer(column, value)
    return sums


def make_interval(mean: float, resampled_means: Float) -> ConfidenceInterval:
    """Return the interval between the percentiles of resampled means that `CONFIDENCE` names."""
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled_means, (tail, 1 - tail))
    return ConfidenceInterval(mean, float(low), float(high))
