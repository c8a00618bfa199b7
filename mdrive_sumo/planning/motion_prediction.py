"""Predicted motions of other road users: the input of the space-time planner."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.parameters import MOTION, MotionParameters
from mdrive_sumo.planning.reference_path import ReferencePath
from mdrive_sumo.planning.speed_lattice import SAMPLE_S

HORIZON_S = 10.0
"""[s] How far ahead the baselines plan: a car at 8 m/s drives 80 m in it."""
STRIDE = 2
"""Footprints are compared at every second sample of a profile, and at every second cell of the path."""
TIMES: Float = np.arange(1, round(HORIZON_S / SAMPLE_S) // STRIDE + 1, dtype=np.float64) * SAMPLE_S * STRIDE
"""(T,) [s] from now: sampling times of predictions."""


@dataclass(frozen=True)
class PredictedMotion:
    """The predicted poses (T, 3) [m, m, rad] of a box centre at `TIMES`, and the size of the box [m].

    After the last row nothing is known and nothing is in the way, except for objects that stand at the end.
    """

    poses: Float
    """(T', 3) with at most as many rows as `TIMES`."""
    length: Float | float
    """One value, or one per row: an object at an uncertain position covers a longer box."""
    width: float
    reason: Reason
    """Why the own car must mind it."""
    stands_at_end: bool = False
    """Whether the object stays at its last pose for ever."""
    min_gap_m: float = 0.0
    """The own car keeps at least this gap [m] behind the box, whatever its margin is."""


def predict_constant_speed(speed: float) -> Float:
    """Return the distance (T,) [m] travelled at constant speed."""
    return speed * TIMES


def predict_acceleration(
    speed: float, top_speed: float = MOTION.top_speed, parameters: MotionParameters = MOTION
) -> Float:
    """Return the distance (T,) [m] travelled by a road user that accelerates to `top_speed` [m/s]."""
    top_speed = max(top_speed, speed)
    ramp_s = (top_speed - speed) / parameters.acceleration
    within = np.minimum(TIMES, ramp_s)
    return speed * within + parameters.acceleration * (within * within) / 2 + top_speed * (TIMES - within)


def predict_hesitation(speed: float, parameters: MotionParameters = MOTION) -> Float:
    """Return the minimum distance (T,) [m] travelled by a road user that goes first: it may slow down a little."""
    braking, hesitation_s = parameters.hesitation_braking, parameters.hesitation_s
    slow = np.minimum(TIMES, hesitation_s)
    lost = braking * (slow * slow) / 2 + braking * hesitation_s * (TIMES - slow)
    return np.maximum.accumulate(np.maximum(speed * TIMES - lost, 0.0))


def predict_yielding(speed: float, parameters: MotionParameters = MOTION) -> Float:
    """Return the distance (T,) [m] travelled by a road user that stops for the own car."""
    reaction_s, braking = parameters.reaction_s, parameters.yielding_braking
    until = np.minimum(np.maximum(TIMES - reaction_s, 0.0), speed / braking)
    return speed * np.minimum(TIMES, reaction_s) + speed * until - braking * (until * until) / 2


def place_on_arc(
    objects: Objects, row: int, travelled: Float, curvature: float, parameters: MotionParameters = MOTION
) -> Float:
    """Return the poses (T, 3) of an object after `travelled` (T,) [m] on an arc, a right angle at most."""
    turned = np.clip(curvature * travelled, -parameters.max_turn_rad, parameters.max_turn_rad)
    yaw = float(objects.yaw[row])
    chord = travelled * portable.sinc(turned / 2 / np.pi)
    cos, sin = portable.cos_sin(yaw + turned / 2)
    x, y = objects.x[row] + chord * cos, objects.y[row] + chord * sin
    return np.column_stack((x, y, yaw + turned))


def place_on_path(path: ReferencePath, s: float, travelled: Float) -> Float:
    """Return the poses (T, 3) of an object that follows the path from arc length s [m] after `travelled` (T,) [m]."""
    stations = s + travelled
    grid = np.arange(len(path.xy)) * (path.length / max(len(path.xy) - 1, 1))
    return np.column_stack((path.get_points(stations), np.interp(stations, grid, path.yaw)))


def get_top_speed(objects: Objects, row: int, top_speed: float = MOTION.top_speed) -> float:
    """Return the speed [m/s] to which an object may accelerate; top_speed: of vehicles."""
    return MOTION.walking_top_speed if objects.kind[row] == Kind.PEDESTRIAN else top_speed
