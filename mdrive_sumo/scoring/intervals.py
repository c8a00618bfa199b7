"""Confidence intervals of the means of a run of several seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_stratified_clustered_mean
from mdrive_sumo.scoring.results import Results, ScenarioResult

BUCKET_MEAN, SCENARIO_MEAN = "bucket mean", "scenario mean"


@dataclass(frozen=True, slots=True)
class MeanIntervals:
    """Means of a group of scenarios with 95 % bootstrap intervals: scenarios are resampled, then seeds within each."""

    group: str
    """A bucket, `BUCKET_MEAN` or `SCENARIO_MEAN`."""
    ds: ConfidenceInterval
    sr: ConfidenceInterval


def compute_mean_intervals(results: Results) -> tuple[MeanIntervals, ...]:
    """Return the intervals of every bucket and of both overall means; void episodes count as 0, as in the means."""
    buckets = [[one for one in results.scenarios if one.bucket == name] for name in results.buckets]
    groups = {name: [bucket] for name, bucket in zip(results.buckets, buckets, strict=True)}
    groups |= {BUCKET_MEAN: buckets, SCENARIO_MEAN: [list(results.scenarios)]}
    return tuple(
        MeanIntervals(name, _compute_interval(parts, "ds"), _compute_interval(parts, "sr"))
        for name, parts in groups.items()
    )


def _compute_interval(parts: Sequence[Sequence[ScenarioResult]], score: str) -> ConfidenceInterval:
    return bootstrap_stratified_clustered_mean([np.array(_collect_values(part, score)) for part in parts])


def _collect_values(results: Sequence[ScenarioResult], score: str) -> list[list[float]]:
    """Return a row of values, one for each seed, for every scenario."""
    rows: dict[str, list[float]] = {}
    for result in results:
        rows.setdefault(result.id, []).append(getattr(result, score))
    return [*rows.values()]
