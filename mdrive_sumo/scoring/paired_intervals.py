"""Intervals of scores and of paired differences, over places, the scenarios of each and their seeds."""

from collections.abc import Iterable, Mapping, Sequence

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import (
    ConfidenceInterval,
    Label,
    ResampledMean,
    bootstrap_nested,
    resample_nested,
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


def list_results(table: ResultTable, names: Iterable[str] | None = None) -> list[ScenarioResult]:
    """Return the results of a table by scenario, in the order of `names` or of the table, each by seed."""
    return [result for name in (table if names is None else names) for _, result in sorted(table[name].items())]


def bootstrap_results(values: Float, results: Sequence[ScenarioResult]) -> ConfidenceInterval:
    """Return the mean of one value for each result, in any shape, with its interval."""
    return bootstrap_nested(values.ravel(), [result.label for result in results])


def compute_score_interval(table: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of a score by its field's name; None if the table is empty."""
    resampled = resample_score(table, name)
    return resampled.make_interval() if resampled else None


def compute_difference_interval(table: ResultTable, base: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of the differences table - base, paired by scenario and seed; None without a pair.

    base: has every seed of the table in each scenario that both have.
    """
    common = [(scenario, seed) for scenario in table if scenario in base for seed in sorted(table[scenario])]
    pairs = [(table[scenario][seed], base[scenario][seed]) for scenario, seed in common]
    values = [getattr(ours, name) - getattr(theirs, name) for ours, theirs in pairs]
    return bootstrap_nested(values, [ours.label for ours, _ in pairs]) if pairs else None


def resample_score(table: ResultTable, name: str, *, by_bucket: bool = False) -> ResampledMean | None:
    """Return a score by its field's name, resampled; None if the table is empty.

    by_bucket: of the mean of the bucket means; each bucket is resampled on its own.
    """
    results = list_results(table)
    if not results:
        return None
    labels: list[Label] = [one.label for one in results]
    strata = [one.bucket for one in results] if by_bucket else None
    return resample_nested([getattr(one, name) for one in results], labels, strata)
