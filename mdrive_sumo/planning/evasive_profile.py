"""Profiles for a car that has no other: they leave the way of a fast vehicle, or collide as late as possible."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.planning.parameters import MARGINS, PLANNER, SafetyMargin
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.reference_path import SPACING_M, PathState, ReferencePath
from mdrive_sumo.planning.speed_lattice import LatticeParameters, choose_lattice
from mdrive_sumo.planning.speed_profile import SpeedProfile, SpeedProfileProblem, build_free_road_problem


@dataclass(frozen=True, slots=True)
class EvasionParameters:
    """Profiles that are compared. Design choices."""

    accelerations: tuple[float, ...] = (-4.0, -6.0, -2.0, 0.0, 2.0, 3.0)
    """[m/s2] Of two that are free equally long the first one is taken: braking leaves more time."""
    step_s: float = 0.25
    """[s] Spacing of the points of a profile, and of the times at which contact is looked for."""
    horizon_s: float = 6.0
    """[s] A car at 33 m/s stands after 5.5 s with the hardest of `accelerations`."""


EVASION = EvasionParameters()
EVASION_LATTICE = LatticeParameters(medium_top_speed=math.inf)
"""Steps of half a second at all speeds: with those of a second a fast car reacts too late."""


def build_evasion_problem(
    path: ReferencePath, speeds: Float, start: PathState, top_speed: float
) -> SpeedProfileProblem:
    """Return the problem of driving on for `horizon_s` on a free road, from a station [m] and speed [m/s].

    speeds: (M,) [m/s] highest at the points of the path; top_speed: [m/s] of the planning scale.
    """
    lattice = choose_lattice(top_speed, EVASION_LATTICE)
    horizon_s = EVASION.horizon_s
    problem = build_free_road_problem(path, speeds, start, 0.0, horizon_s + 1e-6, lattice, horizon_s)
    return replace(problem, wait_penalty=PLANNER.wait_penalty)


def find_evasive_profile(problem: SpeedProfileProblem, block: Callable[[SafetyMargin], Bool]) -> SpeedProfile | None:
    """Return the profile of `build_evasion_problem` that keeps a small margin, or avoids contact; None if all collide.

    block(margin) returns the blocked cells (T, J). The profile is one for now: it does not reach the goal.
    """
    for margin in (MARGINS.check, MARGINS.contact):
        found = find_fastest_profile(problem.add_traffic(block, plan_margin=margin))
        if found is not None:
            return replace(found, reaches_goal=False)
    return None


def find_latest_contact(
    speeds: Float,
    start: PathState,
    find_met: Callable[[Float, Float], Bool],
    present: tuple[SpeedProfile, float] | None = None,
    parameters: EvasionParameters = EVASION,
) -> SpeedProfile:
    """Return the rest of the present profile or a profile of constant acceleration: what meets something last.

    speeds: (M,) [m/s] highest at the points of the path;
    find_met(stations (T,) [m], times (T,) [s]) returns a mask (T,); present: a profile and its age [s].
    """
    best: SpeedProfile | None = None
    longest = -1
    rest = [] if present is None else [_build_rest(*present, parameters)]
    constant = (_build_profile(speeds, start, each, parameters) for each in parameters.accelerations)
    for profile in (*rest, *constant):
        times = np.arange(1, len(profile.s), dtype=np.float64) * parameters.step_s
        met = find_met(profile.s[1:], times)
        free = int(np.flatnonzero(met)[0]) if met.any() else len(met)
        if free > longest:
            best, longest = profile, free
    assert best is not None, "there are accelerations"
    return best


def _build_rest(profile: SpeedProfile, age_s: float, parameters: EvasionParameters) -> SpeedProfile:
    """Return what is left of a profile."""
    step_s = parameters.step_s
    steps = np.arange(round(parameters.horizon_s / step_s) + 2, dtype=np.float64)
    stations = profile.get_stations(age_s + np.asarray(steps * step_s))
    return SpeedProfile(stations[:-1], (stations[1:] - stations[:-1]) / step_s, reaches_goal=False, step_s=step_s)


def _build_profile(speeds: Float, start: PathState, acceleration: float, parameters: EvasionParameters) -> SpeedProfile:
    """Return the profile with that acceleration [m/s2], within the highest speeds."""
    step_s = parameters.step_s
    s, speed = [start.s], [max(start.speed, 0.0)]
    for _ in range(round(parameters.horizon_s / step_s)):
        limit = float(speeds[min(int(s[-1] / SPACING_M), len(speeds) - 1)])
        highest = max(limit, speed[-1] - 4.0 * step_s)
        after = min(max(speed[-1] + acceleration * step_s, 0.0), highest)
        s.append(s[-1] + (speed[-1] + after) / 2 * step_s)
        speed.append(after)
    return SpeedProfile(np.array(s), np.array(speed), reaches_goal=False, step_s=step_s)
