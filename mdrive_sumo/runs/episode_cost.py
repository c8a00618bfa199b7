"""Estimate how long episodes take, so that the longest start first and no worker idles at the end of a run."""

from pathlib import Path

from mdrive_sumo.scenario.reference_times import find_noted_ticks
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks

LIMIT_SHARE = 0.25
"""Share of its time limit that an episode takes without a reference time: the median of `mdrive` is 1 / 4.2."""
OTHERS_PER_CAV = 8
"""Road users without an agent that take as long as one CAV. By the measured times of `constant-speed` in `mdrive`
(tests/bench/jobs.py), this order keeps 16 workers busy for 98 % of the time and 32 for 91 %; known times keep both for
99 %. With 4, 16 or 32 instead, 32 are busy for 92, 69 or 67 %."""


def estimate_cost(scenario: Scenario, folder: Path, ticks: int | None = None) -> float:
    """Return how long an episode takes, in the time of one CAV for one tick.

    folder: of the suite with the scenario. ticks: of the episode, if it has been driven before; else as many as
    `omniscient` took. Raises InputError for unreadable reference times.
    """
    if ticks is None:
        noted = find_noted_ticks(scenario, folder)
        ticks = max(noted.values(), default=0) or round(LIMIT_SHARE * max(compute_time_limit_ticks(scenario).values()))
    others = len(scenario.background.vehicles) + len(scenario.actors)
    return ticks * (len(scenario.egos) + others / OTHERS_PER_CAV)
