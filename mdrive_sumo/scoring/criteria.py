"""What live judge and offline metrics share: the running state of one CAV on its route (protocol 5 to 7).

Scalar Python, because the judge asks once per CAV and tick. All functions are pure and read recorded values.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.scenario.scenario import Ego, Scenario

COMPLETION_WINDOW = 2
"""Route points ahead that one tick may pass (protocol 6)."""
COMPLETE_PERCENT = 99.0
GOAL_RADIUS_M = 10.0
DEVIATION_WINDOW = 5
"""Route points ahead among which the nearest one is looked for (protocol 7.4)."""
DEVIATION_MAX_M = 30.0
DEVIATION_MIN_M = 15.0
DEVIATION_SHARE = 0.30
BLOCKED_SPEED = 0.5
"""[m/s] (protocol 7.5)"""
BLOCKED_TICKS = 30 * TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class RouteReference:
    """The dense route of one CAV as plain floats: points [m], direction of the assigned lane, length [m]."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    cos: tuple[float, ...]
    sin: tuple[float, ...]
    s: tuple[float, ...]

    @property
    def length(self) -> float:
        """Length of the dense route [m]."""
        return self.s[-1]


class RouteProgress(NamedTuple):
    """How far one CAV has come. A named tuple, the cheapest fact to make, for every tick makes a new one."""

    passed: int = 0
    """Index of the last route point that counts as passed (protocol 6)."""
    arrived_tick: int | None = None
    """Tick in which the route was completed; the CAV lives one tick longer."""
    nearest: int = 0
    """Index of the nearest route point, as the deviation rule counts it (protocol 7.4)."""
    off_route_m: float = 0.0
    """Distance along the route [m] covered while at least 15 m away from it."""
    has_deviated: bool = False
    moving_tick: int = 0
    """Last tick with at least 0.5 m/s; 0 if there was none: the clock starts with the scenario (7.5)."""


def build_route_reference(ego: Ego) -> RouteReference:
    """The course of a CAV of a scenario file."""
    return build_reference_along(ego.xy, ego.yaw)


def build_reference_along(xy: Float, yaw: Float) -> RouteReference:
    """The course through points xy (N, 2) [m] whose assigned lanes point to yaw (N,) [rad]."""
    s = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy, axis=0).T))))
    columns = (xy[:, 0], xy[:, 1], np.cos(yaw), np.sin(yaw), s)
    return RouteReference(*(tuple(column.tolist()) for column in columns))


def compute_time_limit_ticks(scenario: Scenario) -> int:
    """The route time-out: int(0.8 s/m * L0 + 8 s), L0 being ego 0's route length for every ego (7.6, K3)."""
    return int(0.8 * build_route_reference(scenario.egos[0]).length + 8.0) * TICKS_PER_SECOND


def advance_index(course: RouteReference, index: int, window: int, x: float, y: float) -> int:
    """Index of the last of the next `window` route points that (x, y) [m] has passed; `index` if none.

    A point is passed when the direction of its lane and the way from it to (x, y) make less than 90 degrees.
    No lateral distance is asked for; a later point may be passed before an earlier one (protocol 6, 7.3c).
    """
    for i in range(index + 1, min(index + window + 1, len(course.x))):
        if (x - course.x[i]) * course.cos[i] + (y - course.y[i]) * course.sin[i] > 0.0:
            index = i
    return index


def update_progress(
    trial: RouteProgress, course: RouteReference, tick: int, x: float, y: float, speed: float
) -> RouteProgress:
    """The trial after the frame of `tick`: box centre at (x, y) [m], signed speed along yaw [m/s].

    To be called for every tick from 0 on. The original's speed is the length of the velocity: it has no sign.
    """
    passed, arrived_tick, nearest, off_route_m, deviated, moving_tick = trial
    if arrived_tick is None:
        passed = advance_index(course, passed, COMPLETION_WINDOW, x, y)
        if _is_complete(course, passed, x, y):
            arrived_tick = tick
    step, square = _find_nearest(course, nearest, x, y)
    if DEVIATION_MIN_M**2 <= square < DEVIATION_MAX_M**2 and step > nearest:
        off_route_m += course.s[step] - course.s[nearest]
        deviated = deviated or off_route_m > DEVIATION_SHARE * course.length
    deviated = deviated or square >= DEVIATION_MAX_M**2
    if abs(speed) >= BLOCKED_SPEED:
        moving_tick = tick
    return RouteProgress(passed, arrived_tick, step, off_route_m, deviated, moving_tick)


def find_end(trial: RouteProgress, tick: int, limit_ticks: int) -> End | None:
    """Whether and how a CAV ends in `tick`, after `observe` of the same tick; it then leaves the world.

    Completing the route ends a CAV one tick later, and until then its collisions count. A CAV that has
    completed its route counts as arrived whatever else befalls it. Of two other ends in one tick deviation
    precedes blocking and blocking the time-out, which the original names only where it has nothing else to
    name.
    """
    end = _find_failure(trial, tick, limit_ticks)
    if trial.arrived_tick is None:
        return end
    return End.ARRIVED if end is not None or tick > trial.arrived_tick else None


def compute_completion_percent(trial: RouteProgress, course: RouteReference) -> float:
    """Route completion RC [%], 0 to 100."""
    return 100.0 if trial.arrived_tick is not None else _compute_percent(course, trial.passed)


def _find_failure(trial: RouteProgress, tick: int, limit_ticks: int) -> End | None:
    if trial.has_deviated:
        return End.DEVIATED
    if tick - trial.moving_tick > BLOCKED_TICKS:
        return End.BLOCKED
    return End.TIMED_OUT if tick >= limit_ticks else None


def _compute_percent(course: RouteReference, passed: int) -> float:
    return 100.0 * course.s[passed] / course.s[-1]


def _is_complete(course: RouteReference, passed: int, x: float, y: float) -> bool:
    if _compute_percent(course, passed) <= COMPLETE_PERCENT:
        return False
    return math.hypot(x - course.x[-1], y - course.y[-1]) < GOAL_RADIUS_M


def _find_nearest(course: RouteReference, index: int, x: float, y: float) -> tuple[int, float]:
    """Index and squared distance [m2] of the nearest route point within the window; of equals the last."""
    best, least = index, math.inf
    for i in range(index, min(index + DEVIATION_WINDOW + 1, len(course.x))):
        dx, dy = x - course.x[i], y - course.y[i]
        square = dx * dx + dy * dy
        if square <= least:
            best, least = i, square
    return best, least
