"""Time limits of the hard tier."""

from collections.abc import Mapping

from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.reference_times import ReferenceTicks
from mdrive_sumo.scenario.scenario import Scenario

LIMIT_FACTOR, LIMIT_EXTRA_S = 1.5, 2.0
"""Time limit of a CAV: so many times the time of `omniscient`, and so many seconds. Half of the time again lets a
driver without privilege be cautious, but not wait until all others are gone; the seconds cover one reaction, and
rounding, on short routes."""


def compute_time_limit_s(reference_ticks: int) -> float:
    """Return the time limit [s] of a CAV that needs so many ticks with `omniscient`."""
    return round(LIMIT_FACTOR * reference_ticks * DT + LIMIT_EXTRA_S, 3)


def compute_time_limits(reference: ReferenceTicks) -> dict[str, float]:
    """Return the time limit [s] by CAV id for the measured times of `omniscient`."""
    return {name: compute_time_limit_s(ticks) for name, ticks in reference.items()}


def set_time_limits(scenario: Scenario, limits_s: Mapping[str, float]) -> Scenario:
    """Return the scenario with the time limit [s] of each CAV."""
    egos = tuple(ego.model_copy(update={"time_limit_s": limits_s[ego.id]}) for ego in scenario.egos)
    return scenario.model_copy(update={"egos": egos})
