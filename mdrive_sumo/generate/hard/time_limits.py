"""Time limits of the hard tier: factor x the time of `omniscient` + 2 s, with a factor for each scenario."""

import math
from collections.abc import Mapping

from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.reference_times import ReferenceTicks
from mdrive_sumo.scenario.scenario import Scenario

LEAST_FACTOR, MOST_FACTOR = 1.15, 1.5
"""Bounds of the factor. Half of the time again lets a driver without privilege be cautious, but not wait until all
others are gone. Below 1.15 `omniscient` itself is late with other seeds, which move the starts by up to a metre."""
FACTOR_STEP = 0.05
"""One second of a drive of 20 s."""
LIMIT_EXTRA_S = 2.0
"""[s] One reaction, and rounding on short routes."""


def compute_time_limit_s(reference_ticks: int, factor: float = MOST_FACTOR) -> float:
    """Return the time limit [s] of a CAV that needs so many ticks with `omniscient`."""
    return round(factor * reference_ticks * DT + LIMIT_EXTRA_S, 3)


def compute_time_limits(reference: ReferenceTicks, factor: float = MOST_FACTOR) -> dict[str, float]:
    """Return the time limit [s] by CAV id for the measured times of `omniscient`."""
    return {name: compute_time_limit_s(ticks, factor) for name, ticks in reference.items()}


def choose_limit_factor(reference: ReferenceTicks, cautious_s: Mapping[str, float | None]) -> float:
    """Return the greatest factor with which some CAV cannot be both safe and in time; else `MOST_FACTOR`.

    cautious_s: least arrival time [s], by CAV id, of a driver without messages that is safe against all that may be
    hidden; None: no such driver ever arrives.
    """
    steps = round((MOST_FACTOR - LEAST_FACTOR) / FACTOR_STEP)
    for factor in (round(MOST_FACTOR - FACTOR_STEP * k, 2) for k in range(steps + 1)):
        if is_missed(compute_time_limits(reference, factor), cautious_s):
            return factor
    return MOST_FACTOR


def is_missed(limits_s: Mapping[str, float], cautious_s: Mapping[str, float | None]) -> bool:
    """Return whether the least arrival time of a safe driver of some CAV (None: never) is above its limit [s]."""
    return any(cautious is None or cautious > limits_s[name] for name, cautious in cautious_s.items())


def find_limit_factor(scenario: Scenario, reference: ReferenceTicks) -> float | None:
    """Return the factor that the time limits of a scenario have; None if they have none within the bounds."""
    limits = {ego.id: ego.time_limit_s for ego in scenario.egos}
    steps = math.ceil((MOST_FACTOR - LEAST_FACTOR) / FACTOR_STEP - 1e-9)
    for factor in (round(MOST_FACTOR - FACTOR_STEP * k, 2) for k in range(steps + 1)):
        if {name: limits.get(name) for name in reference} == compute_time_limits(reference, factor):
            return factor
    return None


def set_time_limits(scenario: Scenario, limits_s: Mapping[str, float]) -> Scenario:
    """Return the scenario with the time limit [s] of each CAV."""
    egos = tuple(ego.model_copy(update={"time_limit_s": limits_s[ego.id]}) for ego in scenario.egos)
    return scenario.model_copy(update={"egos": egos})
