"""Bootstrap intervals of scores and of paired differences, over scenarios and the seeds of each."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.core.statistics import (
    ConfidenceInterval,
    bootstrap_clustered_mean,
    bootstrap_stratified_clustered_mean,
)
from mdrive_sumo.scoring.results import ScenarioResult

ResultTable = Mapping[str, Mapping[int, ScenarioResult]]
"""Results by scenario id and seed."""


def group_by_scenario(results: Sequence[ScenarioResult]) -> dict[str, dict[int, ScenarioResult]]:
    """Return results by scenario id and seed; scenarios with a void result are left out, so that all count the same."""
    found: dict[str, dict[int, ScenarioResult]] = {}
    for result in results:
        found.setdefault(result.id, {})[result.seed] = result
    return {name: by_seed for name, by_seed in found.items() if all(one.status == "ok" for one in by_seed.values())}


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


def compute_stratified_difference(table: ResultTable, base: ResultTable, name: str) -> ConfidenceInterval | None:
    """As `compute_difference_interval`, of the mean of the bucket means: each bucket is resampled on its own."""
    buckets: dict[str, list[list[float]]] = {}
    for scenario in (scenario for scenario in table if scenario in base):
        bucket = next(iter(table[scenario].values())).bucket
        buckets.setdefault(bucket, []).append(_list_differences(table[scenario], base[scenario], name))
    return bootstrap_stratified_clustered_mean([np.array(rows) for rows in buckets.values()]) if buckets else None


def _list_differences(
    results: Mapping[int, ScenarioResult], base: Mapping[int, ScenarioResult], name: str
) -> list[float]:
    return [getattr(results[seed], name) - getattr(base[seed], name) for seed in sorted(results)]
