"""Bootstrap intervals of scores and of paired differences, over scenarios and the seeds of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import (
    ConfidenceInterval,
    bootstrap_clustered_mean,
    make_interval,
    resample_clustered_mean,
    resample_stratified_clustered_mean,
)
from mdrive_sumo.scoring.results import ScenarioResult

ResultTable = Mapping[str, Mapping[int, ScenarioResult]]
"""Results by scenario id and seed."""


def group_by_scenario(results: Sequence[ScenarioResult]) -> dict[str, dict[int, ScenarioResult]]:
    """Return results by scenario id and seed; scenarios with a void result are left out, so that all count the same."""
    by_scenario: dict[str, dict[int, ScenarioResult]] = {}
    for result in results:
        by_scenario.setdefault(result.id, {})[result.seed] = result
    return {
        name: by_seed for name, by_seed in by_scenario.items() if all(one.status == "ok" for one in by_seed.values())
    }


def select_defined(table: ResultTable, name: str) -> ResultTable:
    """Return the scenarios in which a score is defined with every seed."""
    return {
        scenario: by_seed
        for scenario, by_seed in table.items()
        if all(getattr(one, name) is not None for one in by_seed.values())
    }


def compute_score_interval(table: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of a score by its field's name; None if the table is empty."""
    values = [[getattr(one, name) for _, one in sorted(by_seed.items())] for by_seed in table.values()]
    return bootstrap_clustered_mean(np.array(values)) if values else None


def compute_difference_interval(table: ResultTable, base: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of the differences table - base, paired by scenario and seed; None without a pair.

    base: has every seed of the table in each scenario that both have.
    """
    values = [_list_differences(table[scenario], base[scenario], name) for scenario in table if scenario in base]
    return bootstrap_clustered_mean(np.array(values)) if values else None


@dataclass(frozen=True, slots=True)
class ResampledScore:
    """The mean of a score and its resampled means. Those over the same scenarios and seeds are drawn alike."""

    mean: float
    resampled: Float
    units: int
    """Number of scenarios; of buckets that are drawn apart the number in the smallest."""

    def subtract(self, other: "ResampledScore") -> ConfidenceInterval:
        """Return mean and interval of the differences self - other, paired by scenario and seed.

        other: over the same scenarios and seeds. The result is that of `compute_difference_interval`, whose draws
        this saves where each of many agents is compared with each.
        """
        return make_interval(self.mean - other.mean, self.resampled - other.resampled, self.units)


def resample_score(table: ResultTable, name: str, *, by_bucket: bool = False) -> ResampledScore | None:
    """Return a score by its field's name, resampled over scenarios and seeds; None if the table is empty.

    by_bucket: of the mean of the bucket means; each bucket is resampled on its own.
    """
    buckets: dict[str, list[list[float]]] = {}
    for _, by_seed in sorted(table.items()):
        values = [getattr(one, name) for _, one in sorted(by_seed.items())]
        buckets.setdefault(next(iter(by_seed.values())).bucket if by_bucket else "", []).append(values)
    groups = [np.array(rows) for _, rows in sorted(buckets.items())]
    if not groups:
        return None
    resampled = resample_stratified_clustered_mean(groups) if by_bucket else resample_clustered_mean(groups[0])
    mean = float(np.mean([values.mean() for values in groups]))
    return ResampledScore(mean, resampled, min(len(values) for values in groups))


def _list_differences(
    results: Mapping[int, ScenarioResult], base: Mapping[int, ScenarioResult], name: str
) -> list[float]:
    return [getattr(results[seed], name) - getattr(base[seed], name) for seed in sorted(results)]
