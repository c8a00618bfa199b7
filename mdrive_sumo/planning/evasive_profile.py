"""The profile that collides last, where all of the search collide: a car may leave the way of a fast vehicle."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.planning.reference_path import SPACING_M
from mdrive_sumo.planning.speed_profile import SpeedProfile


@dataclass(frozen=True, slots=True)
class EvasionParameters:
    """Profiles that are compared. Design choices."""

    accelerations: tuple[float, ...] = (-4.0, -6.0, -2.0, 0.0, 2.0, 3.0)
    """[m/s2] Of two that are free equally long the first one is taken: braking leaves more time."""
    step_s: float = 0.25
    horizon_s: float = 6.0


EVASION = EvasionParameters()


def find_evasive_profile(
    speeds: Float,
    start: tuple[float, float],
    find_met: Callable[[Float, Float], Bool],
    parameters: EvasionParameters = EVASION,
) -> SpeedProfile:
    """Return the profile of constant acceleration that meets something last.

    speeds: (M,) [m/s] highest at the points of the path; start: station [m] and speed [m/s];
    find_met(stations (T,) [m], times (T,) [s]) returns a mask (T,).
    """
    best: SpeedProfile | None = None
    longest = -1
    for acceleration in parameters.accelerations:
        profile = _build_profile(speeds, start, acceleration, parameters)
        times = np.arange(1, len(profile.s), dtype=np.float64) * parameters.step_s
        met = find_met(profile.s[1:], times)
        free = int(np.flatnonzero(met)[0]) if met.any() else len(met)
        if free > longest:
            best, longest = profile, free
    assert best is not None, "there are accelerations"
    return best


def _build_profile(
    speeds: Float, start: tuple[float, float], acceleration: float, parameters: EvasionParameters
) -> SpeedProfile:
    """Return the profile with that acceleration [m/s2], within the highest speeds."""
    step_s = parameters.step_s
    s, speed = [start[0]], [max(start[1], 0.0)]
    for _ in range(round(parameters.horizon_s / step_s)):
        limit = float(speeds[min(int(s[-1] / SPACING_M), len(speeds) - 1)])
        highest = max(limit, speed[-1] - 4.0 * step_s)
        after = min(max(speed[-1] + acceleration * step_s, 0.0), highest)
        s.append(s[-1] + (speed[-1] + after) / 2 * step_s)
        speed.append(after)
    return SpeedProfile(np.array(s), np.array(speed), reaches_goal=False, step_s=step_s)
