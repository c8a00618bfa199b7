"""The numbers of a finished submission: overall, of every bucket, of every category, with confidence intervals."""

from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import fmean

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.runs.compare import CONFIDENCE, RESAMPLES, SEED
from mdrive_sumo.scoring import Means, ScenarioResult, buckets, categories, overall
from server.store.standings import Figures, Summary
from server.store.tables import Job

NAMES = ("ds", "sr")
"""What has an interval; scenarios are drawn anew (those of each bucket apart), a scenario's seeds stay together."""


def summarise(jobs: Sequence[Job]) -> Summary:
    """Overall numbers are means over the buckets, as the paper's are."""
    results = [ScenarioResult.model_validate(job.result) for job in jobs]
    of_bucket = {name: [one for one in results if one.bucket == name] for name in buckets(results)}
    of_category = {name: [one for one in results if one.category == name] for name in categories(results)}
    return {
        "overall": _figures(overall(results).bucket_mean, list(of_bucket.values())),
        "buckets": {name: _figures(means, [of_bucket[name]]) for name, means in buckets(results).items()},
        "categories": {name: _figures(means, [of_category[name]]) for name, means in categories(results).items()},
    }


def _figures(means: Means, groups: Sequence[Sequence[ScenarioResult]]) -> Figures:
    figures: Figures = {name: getattr(means, name) for name in ("ds", "sr", "rc", "ip")}
    for name in NAMES:
        figures[f"{name}_low"], figures[f"{name}_high"] = interval([_values(group, name) for group in groups])
    results = [one for group in groups for one in group]
    kinds = Counter(found.kind for one in results for ego in one.egos for found in ego.infractions)
    return figures | {"scenarios": len({one.id for one in results}), "infractions": dict(sorted(kinds.items()))}


def interval(groups: Iterable[Float]) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the mean of the groups' means; always the same for the same numbers."""
    random = np.random.default_rng(SEED)
    drawn = [values[random.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1) for values in groups]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(np.mean(drawn, axis=0), (tail, 1 - tail))
    return round(float(low), 6), round(float(high), 6)


def _values(results: Sequence[ScenarioResult], name: str) -> Float:
    """One number for every scenario: the mean over its seeds."""
    seeds: dict[str, list[float]] = {}
    for result in results:
        seeds.setdefault(result.id, []).append(getattr(result, name))
    return np.array([fmean(values) for values in seeds.values()])
