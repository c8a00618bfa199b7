"""Choose the scenarios of a short suite that keeps the scores of agents, and so their ranking.

Of every bucket as large a share is chosen, so that the means of buckets stay. Among the scenarios of a bucket those are
chosen over which every agent's mean comes nearest to its mean over the whole bucket: an exchange search, which begins
with scenarios of evenly spaced difficulty and ends where no exchange of two scenarios helps. It begins at several
places, and of what it finds in each bucket those are taken together that keep the ranking best. It draws nothing, so
the same runs choose the same scenarios.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import compute_kendall

STARTS = 8
"""Places at which the search of a bucket begins; three buckets then have 512 choices together."""
AgentScores = Mapping[str, Mapping[str, float]]
"""Mean score over the seeds [%] by agent and scenario id; every agent has all scenarios."""


def choose_scenarios(scores: AgentScores, buckets: Mapping[str, str], count: int) -> list[str]:
    """Return the ids of `count` scenarios in the order of `buckets`.

    buckets: by scenario id. Raises InputError for more scenarios than there are.
    """
    if not 0 < count <= len(buckets):
        raise InputError(f"short suite: expected 1 to {len(buckets)} scenarios, found {count}")
    found: list[list[_Choice]] = []
    for bucket, number in split_count(buckets, count).items():
        names = [scenario for scenario, of in buckets.items() if of == bucket]
        table = np.array([[of_agent[name] for name in names] for of_agent in scores.values()])
        found.append([_choose_columns(table, number, names, start / STARTS) for start in range(STARTS)])
    whole = np.mean([choices[0].whole for choices in found], axis=0)
    together = list(product(*found))
    short = np.array([np.mean([choice.means for choice in choices], axis=0) for choices in together])
    ranks = compute_kendall(short, np.broadcast_to(whole, short.shape))
    best = max(range(len(together)), key=lambda i: (round(float(ranks[i]), 6), -sum(one.cost for one in together[i])))
    chosen = {name for choice in together[best] for name in choice.scenarios}
    return [scenario for scenario in buckets if scenario in chosen]


@dataclass(frozen=True, slots=True)
class _Choice:
    """Scenarios of a bucket, with the agents' means over them and over the whole bucket."""

    scenarios: tuple[str, ...]
    means: Float
    whole: Float

    @property
    def cost(self) -> float:
        return float(portable.square(self.means - self.whole).sum())


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


def _choose_columns(table: Float, number: int, names: Sequence[str], start: float) -> _Choice:
    """Return scenarios over which the means of scores (agents, scenarios) are nearest to those over all.

    start: from 0 to 1, where in each of `number` equal parts of the scenarios by difficulty the search begins.
    """
    order = np.argsort(table.mean(axis=0), kind="stable")
    chosen = [int(order[int((k + start) * len(order) / number)]) for k in range(number)]
    target = number * table.mean(axis=1)
    while left := [column for column in range(table.shape[1]) if column not in chosen]:
        gap = table[:, chosen].sum(axis=1) - target
        change = table[:, None, left] - table[:, chosen, None]  # (agents, out, in)
        cost = portable.square(gap[:, None, None] + change).sum(axis=0)
        out, new = np.unravel_index(int(cost.argmin()), cost.shape)
        if cost[out, new] >= (gap * gap).sum() - 1e-9:
            break
        chosen[int(out)] = left[int(new)]
    return _Choice(tuple(names[column] for column in chosen), table[:, chosen].mean(axis=1), table.mean(axis=1))
