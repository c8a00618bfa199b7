"""What the other road user can do once it can see the CAV: brake or accelerate on its course.

Vehicles react at once and as hard as they can. Pedestrians and cyclists keep their course, as scripted ones do.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.study.need.approach import ApproachState
from mdrive_sumo.study.need.sight_tables import SightTables

DECELERATION = 9.0
"""Greatest deceleration [m/s2]: emergency braking of SUMO's vehicles; a CAV has 8.2 at most."""
ACCELERATION = 4.5
"""Greatest acceleration [m/s2], of a CAV."""


@dataclass(frozen=True)
class UserReaction:
    """The drive of the other road user, and what it can change about it."""

    tables: SightTables

    @property
    def reacts(self) -> bool:
        """Whether it changes its course when it sees the CAV."""
        return bool(self.tables.record.kind[self.tables.zone.road_user] == Kind.VEHICLE)

    @cached_property
    def _way(self) -> Float:
        """(leave + 1,) way driven [m] until each tick."""
        e, i, ticks = self.tables.record, self.tables.zone.road_user, np.arange(self.tables.zone.leave + 1)
        steps = portable.hypot(np.diff(e.x[ticks, i]), np.diff(e.y[ticks, i]))
        return np.concatenate(((0.0,), np.cumsum(np.where(ticks[1:] > self.tables.first_tick, steps, 0.0))))

    def _speed(self, tick: int) -> float:
        after = min(max(tick, self.tables.first_tick) + 1, self.tables.zone.leave)
        return float(self._way[after] - self._way[after - 1]) / DT

    @cached_property
    def stopping_tick(self) -> int:
        """Last tick of the drive at which it can still stop before the zone; -1 if there is none."""
        enter = self.tables.zone.enter
        for tick in range(enter, self.tables.first_tick - 1, -1):
            speed = self._speed(tick)
            if speed * speed / (2.0 * DECELERATION) <= self._way[enter] - self._way[tick]:
                return tick
        return -1

    def can_avoid(self, state: ApproachState, tick: int, lags: Int, sees: Bool) -> bool:
        """Return whether it can avoid the CAV, at a tick of its drive at the last tick before the state.

        sees: (L,) whether it may see the CAV so many ticks (L,) before the state, or after it if negative.
        """
        zone = self.tables.zone
        seeing = int((tick - lags[sees]).min(initial=zone.leave))
        if seeing <= self.stopping_tick:
            return True
        if seeing >= zone.leave:
            return False
        speed, since_s = self._speed(seeing), (seeing - tick) * DT
        ahead, through = (max(float(self._way[at] - self._way[seeing]), 0.0) for at in (zone.enter, zone.leave))
        under_root = speed * speed - 2.0 * DECELERATION * ahead
        if under_root <= 0.0:
            return True
        enter_s = since_s + (speed - math.sqrt(under_root)) / DECELERATION
        leave_s = since_s + (math.sqrt(speed * speed + 2.0 * ACCELERATION * through) - speed) / ACCELERATION
        return enter_s >= state.clear_s or leave_s - DT <= state.enter_s
