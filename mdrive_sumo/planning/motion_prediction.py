"""Where the others will be: what a planner plans around."""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.path import Path
from mdrive_sumo.planning.speed_profile import SAMPLE_S

HORIZON_S = 10.0
SPARSE = 2
"""Footprints are compared at every second sample of a profile, and at every second cell of the path."""
TIMES: Float = np.arange(1, round(HORIZON_S / SAMPLE_S) // SPARSE + 1, dtype=np.float64) * SAMPLE_S * SPARSE
"""(T,) [s] from now: when predictions are asked for."""
FORESIGHT_S = 4.0
"""A moving thing is not believed to go on unchanged for longer; what it does then is not known."""
GOING = 2.0
GOING_SPEED = 8.0
"""Who goes first speeds up by so much [m/s2] to that [m/s]."""
HESITATING, HESITATION_S = 1.0, 1.5
"""... or slows down by so much [m/s2] for so long."""
REACTION_S = 0.3
GIVING_WAY = 3.0
"""[m/s2] How hard somebody is expected to brake who has to let me go first."""
WALKING_SPEED = 3.0
"""[m/s] Who is on foot does not speed up beyond this."""
STANDING_SPEED = 0.2
"""[m/s] Who is slower stands."""
SHARPEST_TURN = math.pi / 2


@dataclass(frozen=True)
class Motion:
    """Where somebody will be: box centres and directions (T, 3) [m, m, rad] at `TIMES`, and the box's size [m].

    Beyond the last row nobody knows: nothing is in the way then, but for things that stand.
    """

    poses: Float
    length: Float | float
    """One value, or one a row: who may be here or there takes up a longer place."""
    width: float
    stands: bool = False


def steady(speed: float) -> Float:
    """(T,) [m] travelled at constant speed."""
    return speed * TIMES


def going(speed: float, top: float = GOING_SPEED) -> Float:
    """(T,) [m] travelled by one who takes its turn."""
    top = max(top, speed)
    ramp_s = (top - speed) / GOING
    within = np.minimum(TIMES, ramp_s)
    return speed * within + GOING * within**2 / 2 + top * (TIMES - within)


def hesitating(speed: float) -> Float:
    """(T,) [m] travelled at the least by one who goes before me: he may slow down a little."""
    slow = np.minimum(TIMES, HESITATION_S)
    lost = HESITATING * slow**2 / 2 + HESITATING * HESITATION_S * (TIMES - slow)
    return np.maximum.accumulate(np.maximum(speed * TIMES - lost, 0.0))


def giving_way(speed: float) -> Float:
    """(T,) [m] travelled by one who stops for me."""
    until = np.minimum(np.maximum(TIMES - REACTION_S, 0.0), speed / GIVING_WAY)
    return speed * np.minimum(TIMES, REACTION_S) + speed * until - GIVING_WAY * until**2 / 2


def on_circle(objects: Objects, row: int, travelled: Float, curvature: float) -> Float:
    """Poses (T, 3) of an object that goes on turning as it does (a right angle at most), after `travelled` (T,) [m]."""
    turned = np.clip(curvature * travelled, -SHARPEST_TURN, SHARPEST_TURN)
    yaw = float(objects.yaw[row])
    chord = travelled * np.sinc(turned / 2 / np.pi)
    x = objects.x[row] + chord * np.cos(yaw + turned / 2)
    y = objects.y[row] + chord * np.sin(yaw + turned / 2)
    return np.column_stack((x, y, yaw + turned))


def along_path(path: Path, s: float, travelled: Float) -> Float:
    """Poses (T, 3) of one who is on that path at s [m] and follows it."""
    stations = s + travelled
    grid = np.arange(len(path.xy)) * (path.length / max(len(path.xy) - 1, 1))
    return np.column_stack((path.points(stations), np.interp(stations, grid, path.yaw)))


def top_speed(objects: Objects, row: int) -> float:
    """How fast [m/s] an object may become."""
    return WALKING_SPEED if objects.kind[row] == Kind.PEDESTRIAN else GOING_SPEED
