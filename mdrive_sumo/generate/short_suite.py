"""Choose the scenarios of a short suite that keeps the scores of agents, and so their ranking.

Of every bucket as large a share is chosen, so that the means of buckets stay. Among the scenarios of a bucket those are
chosen over which every agent's mean comes nearest to its mean over the whole bucket: an exchange search, which begins
with scenarios of evenly spaced difficulty and ends where no exchange of two scenarios helps. It draws nothing, so the
same runs choose the same scenarios.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import compute_kendall

AgentScores = Mapping[str, Mapping[str, float]]
"""Mean score over the seeds [%] by agent and scenario id; every agent has all scenarios."""


def choose_scenarios(scores: AgentScores, buckets: Mapping[str, str], count: int) -> list[str]:
    """Return the ids of `count` scenarios in the order of `buckets`.

    buckets: by scenario id. Raises InputError for more scenarios than there are.
    """
    if not 0 < count <= len(buckets):
        raise InputError(f"short suite: expected 1 to {len(buckets)} scenarios, found {count}")
    chosen: set[str] = set()
    for bucket, number in split_count(buckets, count).items():
        names = [scenario for scenario, of in buckets.items() if of == bucket]
        table = np.array([[of_agent[name] for name in names] for of_agent in scores.values()])
        chosen.update(names[column] for column in _choose_columns(table, number))
    return [scenario for scenario in buckets if scenario in chosen]


def split_count(buckets: Mapping[str, str], count: int) -> dict[str, int]:
    """Return the number of scenarios of each bucket, in proportion to its size, by largest remainders."""
    sizes = {bucket: list(buckets.values()).count(bucket) for bucket in dict.fromkeys(buckets.values())}
    exact = {bucket: count * size / len(buckets) for bucket, size in sizes.items()}
    numbers = {bucket: int(share) for bucket, share in exact.items()}
    for bucket in sorted(exact, key=lambda name: (numbers[name] - exact[name], name))[: count - sum(numbers.values())]:
        numbers[bucket] += 1
    return numbers


def compare_rankings(
    scores: Mapping[str, Mapping[str, float]], chosen: Sequence[str], buckets: Mapping[str, str]
) -> float:
    """Return Kendall's tau-b of the agents by their bucket means over the chosen scenarios and over all."""
    short = [_compute_bucket_mean(of_agent, {name: buckets[name] for name in chosen}) for of_agent in scores.values()]
    whole = [_compute_bucket_mean(of_agent, buckets) for of_agent in scores.values()]
    return float(compute_kendall(np.array(short), np.array(whole)))


def _compute_bucket_mean(scores: Mapping[str, float], buckets: Mapping[str, str]) -> float:
    by_bucket: dict[str, list[float]] = {}
    for scenario, bucket in buckets.items():
        by_bucket.setdefault(bucket, []).append(scores[scenario])
    return float(np.mean([np.mean(values) for values in by_bucket.values()]))


def _choose_columns(table: Float, number: int) -> list[int]:
    """Return columns of scores (agents, scenarios) whose means over each row are nearest to those of the whole."""
    order = np.argsort(table.mean(axis=0), kind="stable")
    chosen = [int(order[int((k + 0.5) * len(order) / number)]) for k in range(number)]
    target = number * table.mean(axis=1)
    while True:
        left = [column for column in range(table.shape[1]) if column not in chosen]
        if not left:
            return chosen
        gap = table[:, chosen].sum(axis=1) - target
        change = table[:, None, left] - table[:, chosen, None]  # (agents, out, in)
        cost = portable.square(gap[:, None, None] + change).sum(axis=0)
        out, new = np.unravel_index(int(cost.argmin()), cost.shape)
        if cost[out, new] >= (gap * gap).sum() - 1e-9:
            return chosen
        chosen[int(out)] = left[int(new)]
