"""Choose the scenarios of a bucket: the paper's means, many places, and scores that tell agents apart."""

from collections.abc import Iterable, Sequence

import numpy as np

from mdrive_sumo.generate.selection_program import Grouping, SelectionProblem, group_items, solve_selection
from mdrive_sumo.scenario.statistics import PAPER
from real2sim.recorded_drives.convert_recording import RecordingOutcome
from real2sim.recorded_drives.probe_scenario import BLIND, BOTH, LATE, SHARING, SINGLE

MEAN_SHARE = 0.02
"""Relative difference of a mean from the paper's; `validate` accepts 5 %."""
MOST_BLIND = 48.0
"""Mean DS of blind driving with the seeds of the probes; with others the aim is 60 at most."""
SINGLE_RANGE = (76.0, 81.0)
"""Mean DS of `single`; with other seeds 75 to 92."""
LEAST_GAIN = 13.0
"""Mean gain in DS of the sharing agents over `single`; with other seeds 2, and an interval above 0."""
LEAST_LOSS = 7.0
"""Mean DS that `sharing` loses by the paper's latency; with other seeds an interval above 0."""
LEAST_PLACES, MOST_SHARE = 24, 0.075
"""Places, and the greatest share of the scenarios at one of them."""
GAIN, GAIN_PLACES = 10.0, 20
"""Gain in DS of `sharing` in a scenario at so many places: intervals are over places."""
AIM_PRICES = (1000.0, 20.0)
"""Price of missing a mean of the paper by all of it, and of a point of DS: 1 % of a mean outweighs half a point."""
MISS_COST = 1.0
"""Points of DS that a missed target of the conversion costs."""


def choose_recordings(pool: Sequence[RecordingOutcome], count: int) -> tuple[RecordingOutcome, ...]:
    """Return `count` of the sound scenarios, in the order of the pool. Raises InputError if the solver finds none."""
    rows, prices = zip(*_build_aims(pool), strict=True)
    problem = SelectionProblem(
        count=count,
        costs=np.array([MISS_COST * len(one.misses) for one in pool]),
        excess=np.array(rows),
        prices=np.array(prices),
        groupings=(
            Grouping(
                group_items([one.item.network for one in pool]),
                min(LEAST_PLACES, count),
                most_of_group=max(round(MOST_SHARE * count), 1),
            ),
            Grouping(
                group_items([one.item.network if _has_gain(one) else None for one in pool]), min(GAIN_PLACES, count)
            ),
        ),
        cliques=(),
    )
    return tuple(pool[i] for i in solve_selection(problem))


def _has_gain(one: RecordingOutcome) -> bool:
    return one.scores[SHARING] - one.scores[SINGLE] >= GAIN


def _build_aims(pool: Sequence[RecordingOutcome]) -> Iterable[tuple[np.ndarray, float]]:
    """Yield excess and price of each aim: the relative excess of a mean, or points of DS."""
    paper = PAPER["v2xpnp"]
    cavs = np.array([float(one.item.cavs) for one in pool])
    ones = np.ones(len(pool))
    for values, weights, aim in (
        (cavs, ones, paper.mean_cavs),
        (np.array([float(one.item.actors) for one in pool]), ones, paper.mean_actors),
        (np.array([one.item.route_m for one in pool]), cavs, paper.mean_route_m),
        (np.array([one.item.heading_change_deg for one in pool]), cavs, paper.mean_heading_change_deg),
    ):
        scale = aim * float(weights.mean())
        yield (values - (1 + MEAN_SHARE) * aim * weights) / scale, AIM_PRICES[0]
        yield ((1 - MEAN_SHARE) * aim * weights - values) / scale, AIM_PRICES[0]
    blind, single, sharing, both, late = (
        np.array([one.scores[probe] for one in pool]) for probe in (BLIND, SINGLE, SHARING, BOTH, LATE)
    )
    for excess in (
        blind - MOST_BLIND,
        single - SINGLE_RANGE[1],
        SINGLE_RANGE[0] - single,
        LEAST_GAIN - (sharing - single),
        LEAST_GAIN - (both - single),
        LEAST_LOSS - (sharing - late),
    ):
        yield excess, AIM_PRICES[1]
