"""Means over scenarios and seeds with bootstrap confidence intervals."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.runs.compare import CONFIDENCE, RESAMPLES, SEED, Interval, bootstrap
from mdrive_sumo.scoring import ScenarioResult

CHUNK = 100
"""So many resamples are in memory at once."""
Table = Mapping[str, Mapping[int, ScenarioResult]]
"""Results by scenario id and seed."""


def by_scenario(scenarios: Sequence[ScenarioResult]) -> dict[str, dict[int, ScenarioResult]]:
    """Without those that are void with any seed, so that every scenario counts the same."""
    found: dict[str, dict[int, ScenarioResult]] = {}
    for scenario in scenarios:
        found.setdefault(scenario.id, {})[scenario.seed] = scenario
    return {name: seeds for name, seeds in found.items() if all(one.status == "ok" for one in seeds.values())}


def interval(values: Float) -> Interval:
    """Mean of values (scenarios, seeds) with its interval: scenarios are drawn anew, then seeds within each.

    With one seed it is `compare.bootstrap`. Both stages are needed: seeds of one scenario are not independent.
    """
    if values.shape[1] == 1:
        return bootstrap(values[:, 0])
    random = np.random.default_rng(SEED)
    means = np.concatenate([_resampled(values, random) for _ in range(RESAMPLES // CHUNK)])
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(means, (tail, 1 - tail))
    return Interval(float(values.mean()), float(low), float(high))


def _resampled(values: Float, random: np.random.Generator) -> Float:
    """Means (CHUNK,) of scenarios and seeds drawn anew."""
    scenarios, seeds = values.shape
    rows = random.integers(scenarios, size=(CHUNK, scenarios, 1))
    columns = random.integers(seeds, size=(CHUNK, scenarios, seeds))
    return values[rows, columns].mean(axis=(1, 2))


def score_interval(table: Table, name: str) -> Interval | None:
    """Of "ds" or "sr" [%]; None if no scenario is left."""
    values = [[getattr(one, name) for _, one in sorted(seeds.items())] for seeds in table.values()]
    return interval(np.array(values)) if values else None


def difference_interval(table: Table, base: Table, name: str) -> Interval | None:
    """Of the paired differences to the base condition; None if no scenario is in both."""
    values = [
        [getattr(table[scenario][seed], name) - getattr(base[scenario][seed], name) for seed in sorted(table[scenario])]
        for scenario in table
        if scenario in base
    ]
    return interval(np.array(values)) if values else None
