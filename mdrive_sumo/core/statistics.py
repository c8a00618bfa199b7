"""Means with confidence intervals by one method: a nested bootstrap over clusters (decision 094).

A value has a label, such as (place, scenario, seed). Values of one place resemble each other, so places are drawn anew,
then the scenarios of each, then the seeds of each scenario (Davison and Hinkley 1997, section 3.8). The ends are
percentiles expanded for the number of places (Hesterberg 2015, "What teachers should know about the bootstrap", section
6.1.3). Every interval draws from the same seed: the same values give the same interval, in whatever order they come.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import pairwise
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

RESAMPLES = 10_000
CONFIDENCE = 0.95
SEED = 0
"""Fixed, so that the same values always give the same interval."""
MIN_UNITS = 10
"""Fewest clusters that give an interval. Of 10 clusters an interval at 95 % holds the true mean in 89 to 99 % of
samples, of 4 in 79 to 99 %; decision 094 has the simulation, also of 12 and 25."""
MIN_EFFECTIVE = 4.0
"""Least effective number of clusters: if most values lie in one of them, the others do not help. At 4 the expanded
percentile is 0.01 %: that of one resample in `RESAMPLES`."""
CHUNK = 500
"""Resamples that are drawn at once; `RESAMPLES` is a multiple."""
Label = tuple[str | int, ...]
"""Clusters of a value from the outermost to itself, e.g. place, scenario, seed."""
Counts = npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    """A mean and the bounds of its confidence interval at level `CONFIDENCE`.

    The only place that decides whether there are enough units for bounds: whatever shows an interval asks `ends`, and
    whatever draws a conclusion asks `judge_interval`, or `judge_intervals` for many.
    """

    mean: float
    low: float | None
    """None for too few clusters."""
    high: float | None
    units: int
    """Number of outermost clusters, as a rule places; of strata the number in the smallest."""
    p_value: float = 1.0
    """Of the hypothesis that the true mean is 0: least level of error at which the interval excludes it."""

    @property
    def ends(self) -> tuple[float, float] | None:
        """Both bounds; None for too few clusters."""
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
    CHANCE = "not after correction"
    """The interval excludes 0, but among so many differences that is likely to happen by chance."""
    TOO_FEW = "too few places"


TOO_FEW_NOTE = f"Fewer than {MIN_UNITS} places (networks) are too few for an interval, and for a verdict."
"""What a table that may have to leave out intervals says about it."""
METHOD_NOTE = (
    "In brackets are 95 % intervals of a nested bootstrap: places (networks) are drawn anew, then the scenarios of"
    " each, then the seeds of each scenario."
)
"""How a table says where its intervals come from."""


def judge_interval(difference: ConfidenceInterval) -> Verdict:
    """Return what the interval of a single difference carries."""
    if difference.ends is None:
        return Verdict.TOO_FEW
    if not difference.is_clear:
        return Verdict.NONE
    return Verdict.GAIN if difference.mean > 0 else Verdict.LOSS


def adjust_holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Return p-values corrected for their number (Holm 1979): at 5 % any error at all has a probability of 5 %.

    It needs no assumption on how the comparisons depend on each other: those of a table share agents and scenarios.
    """
    adjusted = [1.0] * len(p_values)
    highest = 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = highest
    return tuple(adjusted)


def judge_intervals(differences: Sequence[ConfidenceInterval]) -> tuple[Verdict, ...]:
    """Return what the intervals of the differences of one table carry, corrected for their number by `adjust_holm`."""
    alone = [judge_interval(difference) for difference in differences]
    tested = [difference.p_value for difference in differences if difference.ends is not None]
    adjusted = iter(adjust_holm(tested))
    chances = [next(adjusted) if difference.ends is not None else 1.0 for difference in differences]
    return tuple(
        Verdict.CHANCE if verdict in (Verdict.GAIN, Verdict.LOSS) and chance > 1 - CONFIDENCE else verdict
        for verdict, chance in zip(alone, chances, strict=True)
    )


def describe_comparisons(differences: Sequence[ConfidenceInterval | None]) -> str:
    """Return how many of the differences of a table are shown, before and after correction; "" for fewer than two."""
    tested = [difference for difference in differences if difference is not None and difference.ends is not None]
    if len(tested) < 2:
        return ""
    clear = sum(difference.is_clear for difference in tested)
    kept = sum(verdict in (Verdict.GAIN, Verdict.LOSS) for verdict in judge_intervals(tested))
    return (
        f"Of {len(tested)} differences with an interval {clear} exclude 0, where chance alone gives"
        f" {(1 - CONFIDENCE) * len(tested):.1f} if nothing differs; {kept} remain after Holm's correction for their"
        " number."
    )


def describe_too_few(interval: ConfidenceInterval) -> str:
    """Return why a mean has no interval; "" if it has one."""
    if interval.ends is not None:
        return ""
    places = f"{interval.units} place{'' if interval.units == 1 else 's'}"
    if interval.units < MIN_UNITS:
        return f"{places}: too few for an interval, which needs {MIN_UNITS}"
    return f"{places}, but most scenarios lie on fewer than {MIN_EFFECTIVE:.0f} of them: too few for an interval"


def format_interval_cells(interval: ConfidenceInterval | None, form: str = ".2f") -> tuple[str, str, str]:
    """Return mean and both bounds as table cells; "-" for what is undefined. form: of a number, such as "+.2f"."""
    if interval is None:
        return ("-", "-", "-")
    low, high = (f"{end:{form}}" for end in interval.ends) if interval.ends else ("-", "-")
    return (f"{interval.mean:{form}}", low, high)


@dataclass(frozen=True, slots=True)
class ResampledMean:
    """A mean and its resampled means. Those over values with the same labels and strata are drawn alike."""

    mean: float
    resampled: Float
    """(RESAMPLES,)."""
    units: int
    """Number of outermost clusters in the smallest stratum."""
    effective: float
    """Effective number of outermost clusters, of the stratum with the least: see `count_effective`."""

    def make_interval(self) -> ConfidenceInterval:
        """Return mean and interval; without bounds for too few clusters."""
        return make_interval(self.mean, self.resampled, self.units, self.effective)

    def subtract(self, other: "ResampledMean") -> ConfidenceInterval:
        """Return mean and interval of the differences self - other, paired value by value: of the same labels."""
        return make_interval(self.mean - other.mean, self.resampled - other.resampled, self.units, self.effective)


def bootstrap_nested(
    values: Sequence[float] | Float,
    labels: Sequence[Label],
    strata: Sequence[str] | None = None,
    weights: Mapping[str, float] | None = None,
) -> ConfidenceInterval:
    """Return the mean of values (N,), N >= 1, with its interval; all other arguments as in `resample_nested`."""
    return resample_nested(values, labels, strata, weights).make_interval()


def resample_nested(
    values: Sequence[float] | Float,
    labels: Sequence[Label],
    strata: Sequence[str] | None = None,
    weights: Mapping[str, float] | None = None,
) -> ResampledMean:
    """Return the mean of values (N,), and the means of its resamples.

    labels: of each value, all different, with the same number of levels. strata: groups that are resampled apart and
    whose means are averaged, such as buckets; None for one. weights: of the strata in the sum of their means, 1 /
    number of strata by default; negative ones subtract.
    """
    array = np.asarray(values, dtype=np.float64)
    names = ["" for _ in labels] if strata is None else strata
    members_by_stratum: dict[str, list[int]] = {name: [] for name in sorted(set(names))}
    for i in sorted(range(len(labels)), key=labels.__getitem__):
        members_by_stratum[names[i]].append(i)
    shares = dict.fromkeys(members_by_stratum, 1 / len(members_by_stratum)) if weights is None else weights
    mean, resampled = 0.0, np.zeros(RESAMPLES)
    units, effective = len(labels), float(len(labels))
    for stream, (name, members) in enumerate(members_by_stratum.items()):
        inside = [labels[i] for i in members]
        counts = draw_nested_counts(inside, stream)
        means = sum_resamples(counts, array[members]) / counts.sum(axis=1)
        mean, resampled = mean + shares[name] * float(means[0]), resampled + shares[name] * means[1:]
        units = min(units, len({label[0] for label in inside}))
        effective = min(effective, count_effective(inside))
    return ResampledMean(mean, resampled, units, effective)


def count_effective(labels: Sequence[Label]) -> float:
    """Return the effective number of outermost clusters: (sum of n)² / sum of n² over their numbers of values n.

    It is their number if all are alike, and less the more values the largest ones have (Kish 1965).
    """
    _, sizes = np.unique([str(label[0]) for label in labels], return_counts=True)
    return float(sizes.sum()) * float(sizes.sum()) / float((sizes * sizes).sum())


def draw_nested_counts(labels: Sequence[Label], stream: int = 0) -> Counts:
    """Return how often each of N values counts (1 + RESAMPLES, N), for statistics that are no mean.

    The first row is the sample itself, where each counts once. stream: strata that are drawn apart have different ones.
    Raises ValueError for a label that occurs twice.
    """
    order = sorted(range(len(labels)), key=labels.__getitem__)
    ordered = [labels[i] for i in order]
    if any(a == b for a, b in pairwise(ordered)):
        raise ValueError("expected labels that are all different")
    counts = _draw_counts(_list_level_sizes(ordered), stream)
    return counts[np.argsort(order, kind="stable")].T


def _list_level_sizes(ordered: Sequence[Label]) -> tuple[tuple[int, ...], ...]:
    """Return the numbers of children of every node of a tree of sorted labels, level by level; the root comes first.

    A level where each node has one child is left out: there is nothing to draw.
    """
    levels: list[tuple[int, ...]] = []
    nodes: list[Label] = [()]
    for depth in range(1, len(ordered[0]) + 1):
        children = list(dict.fromkeys(label[:depth] for label in ordered))
        if len(children) > len(nodes):
            sizes = dict.fromkeys(nodes, 0)
            for child in children:
                sizes[child[: len(nodes[0])]] += 1
            levels.append(tuple(sizes.values()))
            nodes = children
        elif len(nodes[0]):
            nodes = children
    return tuple(levels) or ((1,),)


@lru_cache(maxsize=8)  # a table asks for the same places, scenarios and seeds again and again
def _draw_counts(levels: tuple[tuple[int, ...], ...], stream: int) -> Counts:
    """Return how often each value counts, (N, 1 + RESAMPLES); the first column is 1."""
    random = np.random.default_rng((SEED, stream))
    size = sum(levels[-1])
    counts = np.ones((size, 1 + RESAMPLES), dtype=np.uint16)
    for start in range(0, RESAMPLES, CHUNK):
        nodes, rows = np.zeros(CHUNK, dtype=np.int64), np.arange(CHUNK)
        for level in levels:
            sizes = np.array(level)
            drawn = sizes[nodes]
            first = np.repeat((np.cumsum(sizes) - sizes)[nodes], drawn)
            nodes, rows = first + random.integers(0, np.repeat(drawn, drawn)), np.repeat(rows, drawn)
        drawn_counts = np.bincount(nodes * CHUNK + rows, minlength=size * CHUNK).reshape(size, CHUNK)
        counts[:, 1 + start : 1 + start + CHUNK] = drawn_counts
    counts.flags.writeable = False
    return counts


def sum_resamples(counts: npt.NDArray[np.generic], values: Float) -> Float:
    """Return the sums (R, ...) of values (N, ...) where value j counts `counts[r, j]` times; no sum depends on R.

    It adds one value after the other, because a matrix product has other last bits on other machines.
    """
    sums = np.zeros((len(counts), *values.shape[1:]))
    for column, value in zip(counts.T, values, strict=True):
        sums += np.multiply.outer(column, value)
    return sums


def make_interval(mean: float, resampled: Float, units: int, effective: float) -> ConfidenceInterval:
    """Return the interval between the percentiles of resampled means, expanded for the effective number of clusters.

    units, effective: as in `ResampledMean`; too few give no bounds.
    """
    if units < MIN_UNITS or effective < MIN_EFFECTIVE:
        return ConfidenceInterval(mean, None, None, units)
    tail = compute_expanded_tail(effective)
    low, high = np.quantile(resampled, (tail, 1 - tail))
    beyond = min(int((resampled <= 0).sum()), int((resampled >= 0).sum())) + 1
    p_value = compute_expanded_p_value(min(beyond / (len(resampled) + 1), 0.5), effective)
    return ConfidenceInterval(mean, float(low), float(high), units, p_value)


NORMAL = NormalDist()
QUANTILE = 1.959964
"""Of the normal distribution at `CONFIDENCE`."""


def compute_expanded_tail(clusters: float) -> float:
    """Return the percentile [0, 0.5] of resampled means that stands for 2.5 % with so many clusters, more than one.

    Resampled means spread by the root of (n - 1) / n too little, and the normal quantile is not that of Student's t
    (Hesterberg 2015). t comes from the normal quantile by Wallace (1959), within 1.2 % from 3 degrees of freedom on.
    """
    freedom = clusters - 1
    scaled = QUANTILE * (8 * freedom + 3) / (8 * freedom + 1)
    t_square = freedom * portable.expm1(scaled * scaled / freedom)
    return round(NORMAL.cdf(-float(np.sqrt(clusters / freedom * t_square))), 6)  # bits may differ between machines


def compute_expanded_p_value(tail: float, clusters: float) -> float:
    """Return the two-sided p-value of a share of resampled means beyond 0: `compute_expanded_tail` the other way."""
    freedom, z = clusters - 1, NORMAL.inv_cdf(tail)
    t_square = z * z * freedom / clusters
    wallace = (8 * freedom + 1) / (8 * freedom + 3)
    return round(2 * NORMAL.cdf(-wallace * float(np.sqrt(freedom * portable.log(1 + t_square / freedom)))), 6)


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
