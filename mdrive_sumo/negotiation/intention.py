"""The meaning of the four speed intentions: accelerations, and trajectories along a line (protocol 10.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.v2x.messages import Direction, Intention

INTERVAL_S = 0.2
"""[s] A planning step: the paper's planners decide at 5 Hz."""
POINTS = 20
"""Points of a prediction, `INTERVAL_S` apart: 4 s."""
AFTER_S: Float = np.arange(1, POINTS + 1, dtype=np.float64) * INTERVAL_S
"""(POINTS,) times of the points [s from now]."""

ACCELERATION_RANGES: Mapping[Intention, tuple[float, float]] = MappingProxyType(
    {
        Intention.STOP: (-10.0, -10.0),
        Intention.SLOWER: (-8.0, -1.0),
        Intention.KEEP: (0.0, 0.0),
        Intention.FASTER: (1.0, 5.0),
    }
)
"""Accelerations [m/s2] (in the densest traffic, on a free road); protocol 10.2."""


@dataclass(frozen=True, slots=True)
class IntentionParameters:
    """Parameters of intentions. Source of all without another one: protocol 10.2."""

    top_speed: float = 8.0
    """[m/s] Predicted speeds are clipped to [0, this]."""
    min_keep_speed: float = 4.0
    """[m/s] A slower CAV with priority does not keep its speed, it accelerates (protocol 10.4, 10.5)."""
    near_m: float = 5.0
    """[m] At this distance of the nearest vehicle traffic counts as densest."""
    far_m: float = 50.0
    """[m] From this distance on it counts as free."""
    dense_vehicles: int = 20
    """Number of vehicles, the own one included, in the densest traffic."""
    stop_below: float = -4.0
    """[m/s2] Bounds of the intention of a measured acceleration."""
    slower_below: float = -0.5
    keep_up_to: float = 0.5
    turn_rad: float = math.radians(35)
    """A larger change of direction is a turn."""
    lane_m: float = 2.0
    """A larger lateral offset without a turn is a lane change."""


INTENTION = IntentionParameters()


def convert_to_acceleration(
    intention: Intention,
    nearest_m: float = math.inf,
    vehicles: int = 0,
    parameters: IntentionParameters = INTENTION,
) -> float:
    """Return the acceleration [m/s2] of an intention with the nearest of `vehicles` others at `nearest_m` [m].

    The mean of an interpolation by distance (5 to 50 m) and a harmonic one by number (1 to 20 vehicles).
    """
    low, high = ACCELERATION_RANGES[intention]
    if low == high:
        return low
    near_m, far_m = parameters.near_m, parameters.far_m
    distance_share = (min(max(nearest_m, near_m), far_m) - near_m) / (far_m - near_m)
    density = (min(vehicles + 1, parameters.dense_vehicles) - 1) / (parameters.dense_vehicles - 1)
    by_distance = low + (high - low) * distance_share
    by_number = 1 / (1 / high + (1 / low - 1 / high) * density)
    return (by_distance + by_number) / 2


def classify_acceleration(acceleration: float, parameters: IntentionParameters = INTENTION) -> Intention:
    """Return the intention of a measured acceleration [m/s2]."""
    if acceleration < parameters.stop_below:
        return Intention.STOP
    if acceleration < parameters.slower_below:
        return Intention.SLOWER
    return Intention.KEEP if acceleration <= parameters.keep_up_to else Intention.FASTER


def replace_slow_keep(intention: Intention, speed: float, parameters: IntentionParameters = INTENTION) -> Intention:
    """Return the intention of a CAV that may go: KEEP at a low speed [m/s] becomes FASTER."""
    is_slow = speed < parameters.min_keep_speed
    return Intention.FASTER if intention == Intention.KEEP and is_slow else intention


def predict_trajectory(line: Float, speed: float, acceleration: float) -> Float:
    """Return the points (`POINTS`, 2) every `INTERVAL_S` of a car that starts at the first point of a line (N, 2) [m].

    Constant acceleration [m/s2], the speed [m/s] clipped to [0, `top_speed`]; straight on beyond the end of the line.
    """
    top_speed = INTENTION.top_speed
    travelled = _compute_travelled(min(max(speed, 0.0), top_speed), acceleration, AFTER_S, top_speed)
    return sample_line(measure_line(line), travelled)


def _compute_travelled(speed: float, acceleration: float, times: Float, top_speed: float) -> Float:
    """Return the distance [m] after times [s]: the speed changes until it reaches its bound and stays there."""
    if acceleration == 0.0:
        return speed * times
    bound = top_speed if acceleration > 0 else 0.0
    until = np.minimum(times, (bound - speed) / acceleration)
    return speed * until + acceleration * (until * until) / 2 + bound * (times - until)


@dataclass(frozen=True, slots=True)
class MeasuredLine:
    """A line of which points are sampled more than once."""

    points: Float
    """(N, 2) [m], N >= 1."""
    s: Float
    """(N,) arc lengths [m] at the points."""
    direction: Float
    """(2,) of the last step that moves; empty if none does."""


@twin
def measure_line(points: Float, /) -> MeasuredLine:
    """Return the line through points (N, 2) [m], N >= 1."""
    steps = points[1:] - points[:-1]
    lengths = portable.hypot(steps[:, 0], steps[:, 1])
    moving = np.flatnonzero(lengths > 1e-6)
    direction = steps[moving[-1]] / lengths[moving[-1]] if len(moving) else np.zeros(0)
    return MeasuredLine(points, np.concatenate(((0.0,), np.cumsum(lengths))), direction)


@twin
def sample_line(line: MeasuredLine, stations: Float, /) -> Float:
    """Return the points (K, 2) of a line at arc lengths (K,), the last step extended."""
    points = np.column_stack([np.interp(stations, line.s, line.points[:, axis]) for axis in (0, 1)])
    if not len(line.direction):
        return points
    beyond = stations - line.s[-1]
    return points + np.where(beyond < 0.0, 0.0, beyond)[:, None] * line.direction


def build_line(x: float, y: float, yaw: float, points: Float) -> Float:
    """Return the line (N, 2) of a car at that pose with a trajectory (K, 2); a standing car would go straight on."""
    here = np.array((x, y))
    if len(points) and float(portable.hypot(*(points[-1] - here))) > 0.5:
        return np.vstack((here, points))
    cos, sin = portable.cos_sin(yaw)
    return np.array(((x, y), (x + cos, y + sin)))


@twin
def classify_direction(line: Float, parameters: IntentionParameters = INTENTION, /) -> Direction:
    """Return the direction of a line (N, 2) by its shape: about 30 m of points up to 1 m apart."""
    steps = np.diff(line[:: max(len(line) // 15, 1)], axis=0)
    steps = steps[portable.hypot(steps[:, 0], steps[:, 1]) > 1e-6]
    if len(steps) < 2:
        return Direction.FOLLOW
    first, last = (portable.atan2(step[1], step[0]) for step in (steps[0], steps[-1]))
    turn = wrap_angle(last - first)
    if abs(turn) > parameters.turn_rad:
        return Direction.LEFT if turn > 0 else Direction.RIGHT
    gap = line[-1] - line[0]
    cos, sin = portable.cos_sin(first)
    lateral = cos * gap[1] - sin * gap[0]
    if abs(lateral) > parameters.lane_m and abs(turn) < parameters.turn_rad / 3:
        return Direction.CHANGE_LEFT if lateral > 0 else Direction.CHANGE_RIGHT
    return Direction.FOLLOW
