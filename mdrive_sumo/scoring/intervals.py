"""Confidence intervals of the means of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_nested
from mdrive_sumo.scoring.results import Results, ScenarioResult

BUCKET_MEAN, SCENARIO_MEAN = "bucket mean", "scenario mean"


@dataclass(frozen=True, slots=True)
class MeanIntervals:
    """Means of a group of scenarios with their intervals."""

    group: str
    """A bucket, `BUCKET_MEAN` or `SCENARIO_MEAN`."""
    ds: ConfidenceInterval
    sr: ConfidenceInterval


def compute_mean_intervals(results: Results) -> tuple[MeanIntervals, ...]:
    """Return the intervals of every bucket and of both overall means; void episodes count as 0, as in the means."""
    everything = results.scenarios
    groups = {name: [one for one in everything if one.bucket == name] for name in results.buckets}
    return (
        *(_compute_group(name, members) for name, members in groups.items()),
        _compute_group(BUCKET_MEAN, everything, [one.bucket for one in everything]),
        _compute_group(SCENARIO_MEAN, everything),
    )


def _compute_group(name: str, results: Sequence[ScenarioResult], strata: Sequence[str] | None = None) -> MeanIntervals:
    labels = [one.label for one in results]
    ds, sr = (bootstrap_nested([getattr(one, score) for one in results], labels, strata) for score in ("ds", "sr"))
    return MeanIntervals(name, ds, sr)
