"""Percentiles of short arrays with the bits of NumPy, whose functions for all shapes take ten times as long."""

import math

import numpy as np

from mdrive_sumo.core.geometry import Float


def compute_percentile(values: Float, percent: float) -> float:
    """Return `np.percentile` of values (N,): linear between the two nearest; NaN if one is, and for none."""
    if not len(values):
        return math.nan
    ordered = np.sort(values)
    place = (len(ordered) - 1) * (percent / 100)
    low = int(place)
    below, above = float(ordered[low]), float(ordered[min(low + 1, len(ordered) - 1)])
    if math.isnan(ordered[-1]):
        return math.nan
    share, gap = place - low, above - below
    return above - gap * (1 - share) if share >= 0.5 else below + gap * share


def compute_median(values: Float) -> float:
    """Return `np.median` of values (N,); NaN if one is, and for none."""
    if not len(values):
        return math.nan
    ordered = np.sort(values)
    if math.isnan(ordered[-1]):
        return math.nan
    middle = len(ordered) // 2
    return float(ordered[middle]) if len(ordered) % 2 else (float(ordered[middle - 1]) + float(ordered[middle])) / 2
