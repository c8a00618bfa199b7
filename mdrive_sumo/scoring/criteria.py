"""End criteria of a CAV on its route, for the running episode and for metrics (protocol 5 to 7).

All functions are pure and read recorded values.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.scenario.scenario import Ego, Scenario

COMPLETION_WINDOW = 2
"""Number of route points ahead that one tick may pass (protocol 6)."""
COMPLETE_PERCENT = 99.0
"""A route counts as completed above this share [%], near its end (protocol 6)."""
GOAL_RADIUS_M = 10.0
"""... and within this distance [m] of its last point (protocol 6)."""
DEVIATION_WINDOW = 5
"""Number of route points ahead in which the nearest one is searched (protocol 7.4)."""
DEVIATION_MAX_M = 30.0
"""A CAV this far [m] from its route has deviated (protocol 7.4)."""
DEVIATION_MIN_M = 15.0
"""A CAV this far [m] from its route counts towards `DEVIATION_SHARE` (protocol 7.4)."""
DEVIATION_SHARE = 0.30
"""A CAV has deviated after this share of the route at `DEVIATION_MIN_M` or more from it (protocol 7.4)."""
BLOCKED_SPEED = 0.5
"""[m/s] (protocol 7.5)"""
BLOCKED_TICKS = 30 * TICKS_PER_SECOND
"""A CAV slower than `BLOCKED_SPEED` for longer than this is blocked (protocol 7.5)."""


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


@dataclass(frozen=True, slots=True)
class RouteProgress:
    """Progress of one CAV on its route."""

    passed: int = 0
    """Index of the last route point that counts as passed (protocol 6)."""
    arrived_tick: int | None = None
    """Tick in which the route was completed; the CAV ends one tick later."""
    nearest: int = 0
    """Index of the nearest route point, as the deviation rule counts it (protocol 7.4)."""
    off_route_m: float = 0.0
    """Distance along the route [m] covered while at least 15 m away from it."""
    has_deviated: bool = False
    moving_tick: int = 0
    """Last tick with at least 0.5 m/s; 0 if there was none: the clock starts with the scenario (7.5)."""


def build_route_reference(ego: Ego) -> RouteReference:
    """Return the route reference of a CAV of a scenario file."""
    return build_reference_along(ego.xy, ego.yaw)


def build_reference_along(xy: Float, yaw: Float) -> RouteReference:
    """Return the reference through points xy (N, 2) [m] whose assigned lanes have directions yaw (N,) [rad]."""
    s = np.concatenate(((0.0,), np.cumsum(portable.hypot(*np.diff(xy, axis=0).T))))
    columns = (xy[:, 0], xy[:, 1], *portable.cos_sin(yaw), s)
    return RouteReference(*(tuple(column.tolist()) for column in columns))


def compute_time_limit_ticks(scenario: Scenario) -> Mapping[str, int]:
    """Return the time limit [ticks] by CAV id: its own, rounded to ticks, or that of the protocol.

    The protocol's is int(0.8 s/m * L0 + 8 s), with the route length L0 of ego 0 for every ego (7.6, K3). Route and own
    limits are those of the scenario as written, so that every seed has the same time.
    """
    egos = scenario.as_written.egos
    common = int(0.8 * build_route_reference(egos[0]).length + 8.0) * TICKS_PER_SECOND
    return {
        ego.id: common if ego.time_limit_s is None else max(round(ego.time_limit_s * TICKS_PER_SECOND), 1)
        for ego in egos
    }


@twin
def advance_index(reference: RouteReference, index: int, window: int, x: float, y: float, /) -> int:
    """Return the index of the last of the next `window` route points that (x, y) [m] has passed; `index` if none.

    A point is passed when its lane direction and the vector from it to (x, y) form less than 90 degrees. The lateral
    distance does not matter; a later point may be passed before an earlier one (protocol 6, 7.3c).
    """
    for i in range(index + 1, min(index + window + 1, len(reference.x))):
        if (x - reference.x[i]) * reference.cos[i] + (y - reference.y[i]) * reference.sin[i] > 0.0:
            index = i
    return index


@twin
def update_progress(
    progress: RouteProgress, reference: RouteReference, tick: int, x: float, y: float, speed: float, /
) -> RouteProgress:
    """Return the progress after the frame of `tick`: box centre at (x, y) [m], signed speed along yaw [m/s].

    Call it for every tick from 0 on. The original uses the unsigned speed, the length of the velocity.
    """
    passed, arrived_tick, moving_tick = progress.passed, progress.arrived_tick, progress.moving_tick
    nearest, off_route_m, deviated = progress.nearest, progress.off_route_m, progress.has_deviated
    if arrived_tick is None:
        passed = advance_index(reference, passed, COMPLETION_WINDOW, x, y)
        if _is_complete(reference, passed, x, y):
            arrived_tick = tick
    step, square = _find_nearest(reference, nearest, x, y)
    if DEVIATION_MIN_M * DEVIATION_MIN_M <= square < DEVIATION_MAX_M * DEVIATION_MAX_M and step > nearest:
        off_route_m += reference.s[step] - reference.s[nearest]
        deviated = deviated or off_route_m > DEVIATION_SHARE * reference.length
    deviated = deviated or square >= DEVIATION_MAX_M * DEVIATION_MAX_M
    if abs(speed) >= BLOCKED_SPEED:
        moving_tick = tick
    return RouteProgress(passed, arrived_tick, step, off_route_m, deviated, moving_tick)


def find_end(progress: RouteProgress, tick: int, limit_ticks: int) -> End | None:
    """Return how a CAV ends in `tick`, after `update_progress` of the same tick; None if it does not.

    Completing the route ends a CAV one tick later; until then its collisions count, and another end comes first: a CAV
    that reaches its goal in the tick in which its time runs out has timed out (protocol 6, 7.6). Its route completion
    is 100 % all the same, so DS and SR are those of an arrival. Of several other ends in one tick, deviation precedes
    blocking, and blocking precedes the time-out, which the original reports only without another reason.
    """
    if progress.arrived_tick is not None and tick > progress.arrived_tick:
        return End.ARRIVED
    return _find_failure(progress, tick, limit_ticks)


def compute_completion_percent(progress: RouteProgress, reference: RouteReference) -> float:
    """Return the route completion RC [%], 0 to 100."""
    return 100.0 if progress.arrived_tick is not None else _compute_percent(reference, progress.passed)


def _find_failure(progress: RouteProgress, tick: int, limit_ticks: int) -> End | None:
    if progress.has_deviated:
        return End.DEVIATED
    if tick - progress.moving_tick > BLOCKED_TICKS:
        return End.BLOCKED
    return End.TIMED_OUT if tick >= limit_ticks else None


def _compute_percent(reference: RouteReference, passed: int) -> float:
    return 100.0 * reference.s[passed] / reference.s[-1]


def _is_complete(reference: RouteReference, passed: int, x: float, y: float) -> bool:
    if _compute_percent(reference, passed) <= COMPLETE_PERCENT:
        return False
    return portable.hypot(x - reference.x[-1], y - reference.y[-1]) < GOAL_RADIUS_M


def _find_nearest(reference: RouteReference, index: int, x: float, y: float) -> tuple[int, float]:
    """Return index and squared distance [m2] of the nearest route point in the window; of equal ones the last."""
    best, least = index, math.inf
    for i in range(index, min(index + DEVIATION_WINDOW + 1, len(reference.x))):
        dx, dy = x - reference.x[i], y - reference.y[i]
        square = dx * dx + dy * dy
        if square <= least:
            best, least = i, square
    return best, least
