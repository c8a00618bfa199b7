"""The schedule of a logged vehicle, and the speed that keeps or regains it without racing."""

import math
from bisect import bisect_right

import numpy as np

from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.background import Schedule

ACTION_TICKS = 4
"""Action step of vehicles with a schedule: 0.2 s. Measured: 0.1 s deviates by up to 0.4 m, 0.5 s by up to 3 m."""
CATCH_UP_S = 0.5
"""Time constant [s] of regaining the schedule."""
CATCH_UP_FACTOR = 1.2
"""A late vehicle drives at most at this multiple of the logged speed at that position."""
MIN_CATCH_UP_SPEED = 3.0
"""[m/s] A late vehicle may drive this fast where the log stood or crept: it does not wait there again."""
STANDSTILL_MPS = 0.5
"""A vehicle slower than this at the end of its schedule stood there; a faster one does not stop there when late."""
ON_TIME_M = 0.5
"""[m] Nearer than this to its schedule a vehicle drives as the log did."""
LATE_M = 2.0
"""A vehicle further than this [m] behind its schedule observes right of way by the rules."""
ARRIVAL_TOLERANCE_M = 0.5
"""Distance [m] to the end of its schedule at which a vehicle has arrived."""


class ScheduleTable:
    """A schedule as plain floats, for look-ups by tick and by position."""

    def __init__(self, schedule: Schedule) -> None:
        times, positions = np.array(schedule.progress).T
        ticks = np.arange(math.ceil(times[-1] / DT - 1e-6) + 1)
        self._at: list[float] = np.interp(ticks * DT, times, positions).tolist()
        rates = np.diff(positions) / np.diff(times)
        moving = rates > 0.0
        self._positions: list[float] = positions[:-1][moving].tolist()
        self._speeds: list[float] = rates[moving].tolist()
        self._ends_moving = bool(rates[-1] > STANDSTILL_MPS)
        self.ends_tick = len(self._at) - 1
        ahead = self._at[ACTION_TICKS:] + self._at[-1:] * ACTION_TICKS
        self._pace = [(there - here) / (ACTION_TICKS * DT) for here, there in zip(self._at, ahead, strict=False)]
        self.ends_m = float(positions[-1])

    def find_position(self, tick: int) -> float:
        """Return the logged position [m along the route] in a tick, clamped to the ends of the schedule."""
        return self._at[self._find_row(tick)]

    def _find_row(self, tick: int) -> int:
        return tick if 0 <= tick <= self.ends_tick else 0 if tick < 0 else self.ends_tick

    def find_speed(self, position: float) -> float:
        """Return the logged speed [m/s] at a position; where the log stood, the speed at which it drove on."""
        if not self._speeds:
            return 0.0
        return self._speeds[max(bisect_right(self._positions, position) - 1, 0)]

    def compute_desired_speed(self, tick: int, position: float) -> float:
        """Return the speed [m/s] to command for `ACTION_TICKS` from `tick` on to a vehicle at `position` [m]."""
        row = self._find_row(tick)
        lag = self._at[row] - position
        speed = max(self._pace[row] + lag / CATCH_UP_S, 0.0)
        if -ON_TIME_M < lag < ON_TIME_M and tick < self.ends_tick:
            return speed
        limit = max(CATCH_UP_FACTOR * self.find_speed(position), MIN_CATCH_UP_SPEED)
        return limit if tick >= self.ends_tick and self._ends_moving else min(speed, limit)
