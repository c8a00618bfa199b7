"""Blind driving, as `constant-speed` does it: when it is where. Encounters are timed by it."""

import math
from functools import lru_cache

import numpy as np

from mdrive_sumo.agents.sensorless import CONSTANT_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.reference_path import SPACING_M, build_path, compute_curve_speeds
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.lane_chains import RouteLine

BLIND_SPEED, BLIND_ACCELERATION = 8.0, 2.5
"""[m/s], [m/s2] Parameters of `constant-speed` (protocol 14.2)."""
STEP_M = 0.5
"""[m] Step of the stations at which arrival times are tabulated: 0.06 s at 8 m/s."""


def blind_travel_time(distance: float) -> float:
    """Return the time [s] in which blind driving covers a distance [m] from rest."""
    speeding = (BLIND_SPEED * BLIND_SPEED) / 2 / BLIND_ACCELERATION
    if distance < speeding:
        return math.sqrt(2 * max(distance, 0.0) / BLIND_ACCELERATION)
    return BLIND_SPEED / BLIND_ACCELERATION + (distance - speeding) / BLIND_SPEED


def blind_distance(time: float) -> float:
    """Return the distance [m] that blind driving covers in a time [s] from rest."""
    speeding = BLIND_SPEED / BLIND_ACCELERATION
    if time < speeding:
        return BLIND_ACCELERATION * portable.square(max(time, 0.0)) / 2
    return BLIND_SPEED * (time - speeding / 2)


def compute_arrival_s(line: RouteLine, start: float, station: float) -> float:
    """Return the time [s] in which blind driving gets from rest at `start` to `station` [m], slower in bends."""
    away = np.arange(0.0, max(station - start, STEP_M) + STEP_M / 2, STEP_M)
    rising = np.diff(np.sqrt(2 * away / BLIND_ACCELERATION))
    bends = np.interp(start + away[1:], np.arange(len(line.xy)), _curve_speed_profile(line))
    return float(np.maximum(rising, STEP_M / bends).sum())


@lru_cache(maxsize=4096)
def _curve_speed_profile(line: RouteLine) -> Float:
    """Return the speed of blind driving [m/s] at the points of a line, except near the start."""
    path = build_path(line.xy, CAR.rear_to_centre)
    speeds = compute_curve_speeds(path, BLIND_SPEED, CONSTANT_SPEED.lateral_acceleration, CONSTANT_SPEED.braking)
    share = np.linspace(0.0, path.goal_s, len(line.xy))
    return np.interp(share, np.arange(len(speeds)) * SPACING_M, speeds)
