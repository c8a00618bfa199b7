"""Shrink scenario files: drop timed poses that lie on the straight line between their neighbours."""

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.background import BackgroundVehicle, Schedule
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion

AWAY_M, TURNED_RAD = 0.03, 0.05
"""Tolerance of a pose [m], [rad]. The smallest noise in a log is 0.06 m."""
WALKER_TURNED_RAD = 0.3
"""The same for pedestrians, whose heading has no effect."""


def thin_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with thinned replays and schedules, which are interpolated linearly."""
    vehicles = tuple(map(_thin_vehicle, scenario.background.vehicles))
    background = scenario.background.model_copy(update={"vehicles": vehicles})
    return scenario.model_copy(update={"background": background, "actors": tuple(map(_thin_actor, scenario.actors))})


def _thin_actor(actor: Actor) -> Actor:
    if not isinstance(actor.motion, ReplayMotion):
        return actor
    turned = WALKER_TURNED_RAD if actor.kind == "pedestrian" else TURNED_RAD
    poses = actor.motion.poses
    kept = _select_needed(np.array(poses), np.array((AWAY_M, AWAY_M, turned)))
    return actor.model_copy(update={"motion": actor.motion.model_copy(update={"poses": tuple(poses[k] for k in kept)})})


def _thin_vehicle(vehicle: BackgroundVehicle) -> BackgroundVehicle:
    if vehicle.schedule is None:
        return vehicle
    progress = vehicle.schedule.progress
    kept = _select_needed(np.array(progress), np.array((AWAY_M,)))
    schedule: Schedule = vehicle.schedule.model_copy(update={"progress": tuple(progress[k] for k in kept)})
    return vehicle.model_copy(update={"schedule": schedule})


def _select_needed(rows: Float, away: Float) -> list[int]:
    """Return the rows of (N, 1 + K), time and K values, needed to keep all within `away` (K,) of the lines.

    The method of Ramer (1972), with differences at the same time instead of distances.
    """
    kept, parts = {0, len(rows) - 1}, [(0, len(rows) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        share = (rows[first:last, :1] - rows[first, 0]) / (rows[last, 0] - rows[first, 0])
        line = rows[first, 1:] + share * (rows[last, 1:] - rows[first, 1:])
        off = (np.abs(rows[first:last, 1:] - line) / away).max(axis=1)
        if off.max() > 1.0:
            worst = first + int(np.argmax(off))
            kept.add(worst)
            parts += [(first, worst), (worst, last)]
    return sorted(kept)
