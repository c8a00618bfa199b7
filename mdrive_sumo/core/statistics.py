"""Means with percentile bootstrap confidence intervals (Efron 1979).

Every interval draws from the same seed, so the same values always give the same interval. What is drawn anew are
units: scenarios, or whatever varies independently. Fewer than `MIN_UNITS` of them give no interval and no verdict.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

RESAMPLES = 10_000
CONFIDENCE = 0.95
SEED = 0
"""Fixed, so that the same values always give the same interval."""
MIN_UNITS = 10
"""Fewest units that give an interval. The percentile interval of few values is too narrow: where there is no difference
it excludes 0 in 10 % of all samples of 10 values, in 15 % of 5, in 25 % of 3 and in 50 % of 2, instead of in 5 %
(4000 samples of normal values; as many of values that are 0 or like differences of driving scores say the same
from 5 on). 10 is where the error is twice the nominal one."""
CHUNK = 100
"""Resamples of a two-stage bootstrap that are in memory at once; RESAMPLES is a multiple."""


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    """A mean and the bounds of its confidence interval at level `CONFIDENCE`.

    The only place that decides whether there are enough units for bounds: whatever shows an interval asks `ends`, and
    whatever draws a conclusion asks `judge_interval`.
    """

    mean: float
    low: float | None
    """None for fewer than `MIN_UNITS`."""
    high: float | None
    units: int
    """Number of units that were drawn anew; of groups that are drawn apart the number in the smallest."""

    @property
    def ends(self) -> tuple[float, float] | None:
        """Both bounds; None for too few units."""
        return None if self.low is None or self.high is None else (self.low, self.high)

    @property
    def is_clear(self) -> bool:
        """Whether the interval shows a difference: it has bounds, and 0 is not between them."""
        return self.ends is not None and (self.ends[0] > 0 or self.ends[1] < 0)


class Verdict(StrEnum):
    """What the interval of a difference carries, in words."""

    GAIN = "gain"
    LOSS = "loss"
    NONE = "no difference shown"
    TOO_FEW = "too few scenarios"


TOO_FEW_NOTE = f"Fewer than {MIN_UNITS} scenarios are too few for an interval, and for a verdict."
"""What a table that may have to leave out intervals says about it."""


def judge_interval(difference: ConfidenceInterval) -> Verdict:
    """Return what the interval of a difference carries."""
    if difference.ends is None:
        return Verdict.TOO_FEW
    if not difference.is_clear:
        return Verdict.NONE
    return Verdict.GAIN if difference.mean > 0 else Verdict.LOSS


def describe_too_few(units: int) -> str:
    """Return why there is no interval over so many scenarios; "" if there is one."""
    what = f"{units} scenario{'' if units == 1 else 's'}"
    return f"{what}: too few for an interval, which needs {MIN_UNITS}" if units < MIN_UNITS else ""


def format_interval_cells(interval: ConfidenceInterval | None, form: str = ".2f") -> tuple[str, str, str]:
    """Return mean and both bounds as table cells; "-" for what is undefined. form: of a number, such as "+.2f"."""
    if interval is None:
        return ("-", "-", "-")
    low, high = (f"{end:{form}}" for end in interval.ends) if interval.ends else ("-", "-")
    return (f"{interval.mean:{form}}", low, high)


def bootstrap_mean(values: Float) -> ConfidenceInterval:
    """Return the mean of values (N,), N >= 1, with its interval: the values, e.g. paired differences, are resampled.

    With one value per scenario, the interval says how the mean would vary over suites like this one.
    """
    return bootstrap_stratified_mean((values,))


def bootstrap_stratified_mean(groups: Sequence[Float]) -> ConfidenceInterval:
    """Return the mean of the means of the groups, (N,) each with N >= 1; every group is resampled on its own."""
    mean = float(np.mean([values.mean() for values in groups]))
    return make_interval(mean, _resample_stratified_mean(groups), _count_units(groups))


def bootstrap_clustered_mean(values: Float) -> ConfidenceInterval:
    """Return the mean of values (scenarios, seeds) with its interval: resamples scenarios, then seeds within each.

    Both stages are needed because the seeds of one scenario are not independent. With one seed it is `bootstrap_mean`.
    """
    return make_interval(float(values.mean()), resample_clustered_mean(values), len(values))


def bootstrap_stratified_clustered_mean(groups: Sequence[Float]) -> ConfidenceInterval:
    """Return the mean of the means of the groups, (scenarios, seeds) each; every group is resampled on its own.

    Within a group it resamples as `bootstrap_clustered_mean`.
    """
    resampled = resample_stratified_clustered_mean(groups)
    return make_interval(float(np.mean([values.mean() for values in groups])), resampled, _count_units(groups))


def _count_units(groups: Sequence[Float]) -> int:
    return min(len(values) for values in groups)


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


def make_interval(mean: float, resampled_means: Float, units: int) -> ConfidenceInterval:
    """Return the interval between the percentiles of resampled means that `CONFIDENCE` names; without bounds for few.

    units: number of units that were drawn anew; of groups that are drawn apart the number in the smallest.
    """
    if units < MIN_UNITS:
        return ConfidenceInterval(mean, None, None, units)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(resampled_means, (tail, 1 - tail))
    return ConfidenceInterval(mean, float(low), float(high), units)


DECIMALS = 9
"""Values that differ by less are ties: sums of the same numbers in another order differ in the last bits."""


def compute_spearman(x: Float, y: Float) -> Float:
    """Return Spearman's rho over the last axis of arrays (..., N); ties have their mean rank, NaN where all are tied.

    It is Pearson's correlation of the ranks (Spearman 1904), which equals SciPy's `spearmanr`.
    """
    ranks = [_compute_ranks(values) for values in (x, y)]
    first, second = (values - values.mean(axis=-1, keepdims=True) for values in ranks)
    return _divide((first * second).sum(axis=-1), (first * first).sum(axis=-1) * (second * second).sum(axis=-1))


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


NESTED_RESAMPLES = 2_000
"""Resamples of a bootstrap of three stages, of which only the standard deviation is used; a multiple of `CHUNK`. It
then differs by 1.6 % from that of another seed."""
STUDENT_T = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306)
"""Quantile 0.975 of Student's t for 1 to 8 degrees of freedom: of 2 to 9 units (Student 1908)."""
NORMAL_QUANTILE = 2.262
"""That of 9 degrees of freedom, which all larger numbers of units get: from there on it falls to 1.96 only."""


@dataclass(frozen=True, slots=True)
class NestedMean:
    """The mean of the means of groups, and how uncertain it is; see `compute_nested_mean`."""

    mean: float
    error: float
    """Standard error."""
    units: int
    """Number of groups."""

    def make_interval(self, other: "NestedMean | None" = None) -> ConfidenceInterval:
        """Return mean and interval; of one group without bounds.

        other: subtracted, with an error of its own that comes from within its groups.
        """
        mean = self.mean - (other.mean if other else 0.0)
        if self.units < 2:
            return ConfidenceInterval(mean, None, None, self.units)
        freedom = self.units - 2
        quantile = STUDENT_T[freedom] if freedom < len(STUDENT_T) else NORMAL_QUANTILE
        half = quantile * float(portable.hypot(self.error, other.error if other else 0.0))
        return ConfidenceInterval(mean, mean - half, mean + half, self.units)


def compute_nested_mean(groups: Sequence[Float]) -> NestedMean:
    """Return the mean of the means of groups, (scenarios, seeds) each, e.g. of seasons, with its standard error.

    Groups are drawn anew, then the scenarios of each, then the seeds of each scenario. The percentiles of so few groups
    would be too near (`MIN_UNITS`), so the error is the standard deviation of the resampled means, corrected for the
    number of groups. It is rather too large than too small, because the means of groups vary by their scenarios, too.
    The error of one group is that of its scenarios and seeds.
    """
    random = np.random.default_rng(SEED)
    count = len(groups)
    drawn = random.integers(count, size=(count, NESTED_RESAMPLES))
    means = np.zeros(NESTED_RESAMPLES)
    for slot in drawn:
        for group, values in enumerate(groups):
            resampled = np.concatenate([_resample_clusters(values, random) for _ in range(NESTED_RESAMPLES // CHUNK)])
            means += np.where(slot == group, resampled, 0.0)
    spread = float((means / count).std())
    correction = float(np.sqrt(count / (count - 1))) if count > 1 else 1.0
    return NestedMean(float(np.mean([values.mean() for values in groups])), spread * correction, count)
