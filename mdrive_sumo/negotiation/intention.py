"""What the four speed intentions mean: accelerations, and trajectories along a way (protocol 10.2)."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.v2x.messages import Direction, Intention

INTERVAL_S = 0.2
POINTS = 20
"""A prediction reaches 4 s ahead."""
AFTER_S: Float = np.arange(1, POINTS + 1, dtype=np.float64) * INTERVAL_S
"""(POINTS,) when its points are due [s from now]."""
TOP_SPEED = 8.0
"""[m/s] Predicted speeds are clipped to [0, this]."""
PATIENT_SPEED = 4.0
"""[m/s] Who is slower and has priority does not keep its speed, it goes faster (protocol 10.4, 10.5)."""

RANGES: Mapping[Intention, tuple[float, float]] = MappingProxyType(
    {
        Intention.STOP: (-10.0, -10.0),
        Intention.SLOWER: (-8.0, -1.0),
        Intention.KEEP: (0.0, 0.0),
        Intention.FASTER: (1.0, 5.0),
    }
)
"""Accelerations [m/s2] among which traffic chooses: (in the densest, on a free road)."""
NEAR_M, FAR_M = 5.0, 50.0
CROWD = 20
TURN = math.radians(35)
LANE_M = 2.0


def convert_to_acceleration(intention: Intention, nearest_m: float = math.inf, vehicles: int = 0) -> float:
    """What an intention means [m/s2] with the nearest of so many vehicles that far away [m].

    The mean of an interpolation by distance (5 to 50 m) and a harmonic one by number (1 to 20, oneself counted).
    """
    low, high = RANGES[intention]
    if low == high:
        return low
    far = (min(max(nearest_m, NEAR_M), FAR_M) - NEAR_M) / (FAR_M - NEAR_M)
    crowd = (min(vehicles + 1, CROWD) - 1) / (CROWD - 1)
    by_distance = low + (high - low) * far
    by_number = 1 / (1 / high + (1 / low - 1 / high) * crowd)
    return (by_distance + by_number) / 2


def classify_acceleration(accelerating: float) -> Intention:
    """The label of an acceleration [m/s2]."""
    if accelerating < -4.0:
        return Intention.STOP
    if accelerating < -0.5:
        return Intention.SLOWER
    return Intention.KEEP if accelerating <= 0.5 else Intention.FASTER


def replace_slow_keep(intention: Intention, speed: float) -> Intention:
    """The intention of one who may go: keeping a low speed [m/s] becomes going faster."""
    return Intention.FASTER if intention == Intention.KEEP and speed < PATIENT_SPEED else intention


def predict_trajectory(way: Float, speed: float, accelerating: float) -> Float:
    """Points (`POINTS`, 2) every `INTERVAL_S` of a car that starts at the first point of its way (N, 2) [m].

    Constant acceleration [m/s2], the speed [m/s] clipped to [0, `TOP_SPEED`]; beyond the end of the way straight on.
    """
    return sample_polyline(way, _travelled(min(max(speed, 0.0), TOP_SPEED), accelerating, AFTER_S))


def _travelled(speed: float, accelerating: float, times: Float) -> Float:
    """Distance [m] after times [s]: until the speed meets its bound, and from then on at that."""
    if accelerating == 0.0:
        return speed * times
    bound = TOP_SPEED if accelerating > 0 else 0.0
    until = np.minimum(times, (bound - speed) / accelerating)
    return speed * until + accelerating * until**2 / 2 + bound * (times - until)


def sample_polyline(way: Float, stations: Float) -> Float:
    """Points (K, 2) at arc lengths (K,) of a chain of points (N, 2), its last step prolonged."""
    steps = np.diff(way, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    s = np.concatenate(((0.0,), np.cumsum(lengths)))
    points = np.column_stack((np.interp(stations, s, way[:, 0]), np.interp(stations, s, way[:, 1])))
    moving = np.flatnonzero(lengths > 1e-6)
    if len(moving):
        last = moving[-1]
        points += np.maximum(stations - s[-1], 0.0)[:, None] * (steps[last] / lengths[last])
    return points


def build_way(x: float, y: float, yaw: float, points: Float) -> Float:
    """The way (N, 2) of a car at that pose with a trajectory (K, 2); one that stands would go straight on."""
    here = np.array((x, y))
    if len(points) and float(np.hypot(*(points[-1] - here))) > 0.5:
        return np.vstack((here, points))
    return np.array(((x, y), (x + math.cos(yaw), y + math.sin(yaw))))


def classify_direction(way: Float) -> Direction:
    """Where a way (N, 2) leads, told by its shape: N points 1 m or so apart, some 30 m of them."""
    steps = np.diff(way[:: max(len(way) // 15, 1)], axis=0)
    steps = steps[np.hypot(steps[:, 0], steps[:, 1]) > 1e-6]
    if len(steps) < 2:
        return Direction.FOLLOW
    first, last = (math.atan2(step[1], step[0]) for step in (steps[0], steps[-1]))
    turn = wrap_angle(last - first)
    if abs(turn) > TURN:
        return Direction.LEFT if turn > 0 else Direction.RIGHT
    gap = way[-1] - way[0]
    aside = math.cos(first) * gap[1] - math.sin(first) * gap[0]
    if abs(aside) > LANE_M and abs(turn) < TURN / 3:
        return Direction.CHANGE_LEFT if aside > 0 else Direction.CHANGE_RIGHT
    return Direction.FOLLOW
