"""Whether times fall into two groups: an agent that sends bits by answering early or late has such thinking times."""

import math
from collections.abc import Sequence
from itertools import accumulate

from mdrive_sumo.core import portable

MIN_VALUES = 40
"""Fewer times say nothing: two seconds of driving."""
MIN_SHARE = 0.05
"""Least share of the smaller group: rarer times are outliers (imports, garbage collection), which carry few bits."""
MIN_GAP_S = 0.002
"""Least distance of the groups [s]: less drowns in the noise of a busy machine."""
BIMODAL_D = 4.0
"""Ashman's D from which times count as bimodal.

Ashman, Bird and Zepf (Astronomical Journal 108, 1994) call two given normal distributions separate from D = 2. Here the
best split of the values themselves is taken, which separates any sample: a normal distribution by 2.65, a uniform one
by 2 sqrt(3) = 3.46, the largest of all unimodal symmetric ones.
"""


def describe_modes(times_s: Sequence[float]) -> dict[str, float] | None:
    """Return the best split of times [s] into two groups: Ashman's `d`, means `low_ms` and `high_ms`, `high_share`.

    The split minimises the variance of the logarithms within the groups (Otsu, IEEE Transactions on Systems, Man and
    Cybernetics 9, 1979); D is that of the logarithms. None for too few values, or if no group has `MIN_SHARE` of them.
    """
    ordered = sorted(max(value, 1e-6) for value in times_s)
    count = len(ordered)
    if count < MIN_VALUES:
        return None
    logs = [portable.log(value) for value in ordered]
    sums, squares = [0.0, *accumulate(logs)], [0.0, *accumulate(value * value for value in logs)]

    def measure(begin: int, end: int) -> tuple[float, float]:
        mean = (sums[end] - sums[begin]) / (end - begin)
        return mean, max(0.0, (squares[end] - squares[begin]) / (end - begin) - mean * mean)

    least = max(1, int(MIN_SHARE * count))
    split = min(
        range(least, count - least + 1),
        key=lambda cut: cut * measure(0, cut)[1] + (count - cut) * measure(cut, count)[1],
    )
    (low, low_variance), (high, high_variance) = measure(0, split), measure(split, count)
    spread = max(math.sqrt(low_variance + high_variance), 1e-6)
    return {
        "d": round(math.sqrt(2.0) * (high - low) / spread, 3),
        "low_ms": round(1000 * sum(ordered[:split]) / split, 3),
        "high_ms": round(1000 * sum(ordered[split:]) / (count - split), 3),
        "high_share": round((count - split) / count, 4),
    }


def is_bimodal(modes: dict[str, float] | None) -> bool:
    """Return whether the groups of `describe_modes` are apart."""
    return modes is not None and modes["d"] >= BIMODAL_D and modes["high_ms"] - modes["low_ms"] >= 1000 * MIN_GAP_S
