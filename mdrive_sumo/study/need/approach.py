"""What a CAV and another road user can still do before they meet: brake, or accelerate on their courses."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.study.need.conflict_zone import ConflictZone
from mdrive_sumo.study.need.motion import RouteMotion
from mdrive_sumo.study.need.sight_tables import SightTables

OVERRUN_M = 0.25
"""A CAV that can stop no further than this inside a zone counts as able to stop before it."""
DECELERATION = 9.0
"""Greatest deceleration [m/s2]: emergency braking of SUMO's vehicles; a CAV has 8.2 at most."""
ACCELERATION = 4.5
"""Greatest acceleration [m/s2], of a CAV."""


@dataclass(frozen=True)
class ApproachState:
    """All states at stations from `back_m` to `front_m` [m] with speeds from `slow` to `fast` [m/s]."""

    motion: RouteMotion
    zone: ConflictZone
    back_m: float
    front_m: float
    slow: float
    fast: float

    @property
    def is_committed(self) -> bool:
        """Whether in none of these states the CAV can stop before the zone."""
        left = self.zone.enter_m + OVERRUN_M - self.back_m
        return self.slow * self.slow >= 2.0 * self.motion.deceleration * left

    @property
    def is_reachable(self) -> bool:
        """Whether the CAV can be as fast here as these states are."""
        first, last = (int(place_m / (self.motion.stations[1])) for place_m in (self.back_m, self.front_m))
        return self.slow <= float(self.motion.fastest[first : last + 2].max(initial=0.0))

    @cached_property
    def earliest_s(self) -> float:
        """Least time [s] from the start."""
        return self.motion.compute_time_to(self.back_m, self.fast)

    @cached_property
    def remaining_s(self) -> float:
        """Least time [s] to the goal."""
        return self.motion.compute_time_from(self.front_m, self.fast)

    @cached_property
    def clear_s(self) -> float:
        """Least time [s] until the zone is left, under full acceleration."""
        distance, speed = self.zone.leave_m - self.front_m, self.fast
        if distance <= 0.0:
            return 0.0
        gain, top = self.motion.limits.acceleration, max(self.motion.top_speed, self.fast)
        until_top = (top * top - speed * speed) / (2.0 * gain)
        if distance <= until_top:
            return (math.sqrt(speed * speed + 2.0 * gain * distance) - speed) / gain
        return (top - speed) / gain + (distance - until_top) / top

    @cached_property
    def enter_s(self) -> float:
        """Greatest time [s] until the zone is entered, under full braking, if the CAV cannot stop before it."""
        distance, brake = max(self.zone.enter_m - self.back_m, 0.0), self.motion.deceleration
        left = self.slow * self.slow - 2.0 * brake * distance
        return math.inf if left < 0.0 else (self.slow - math.sqrt(left)) / brake

    def compute_past(self, seconds: Float) -> tuple[Float, Float]:
        """Return the least station [m] between so many seconds and a tick before, and the greatest; any shape.

        seconds: before one of these states; the CAV may have been there up to a tick earlier.
        """
        gain, brake = self.motion.limits.acceleration, self.motion.deceleration
        top = max(self.motion.top_speed, self.fast)
        moving = np.minimum(seconds, self.slow / gain)
        least = self.slow * moving - gain * moving * moving / 2.0
        earlier = seconds + 0.05
        slowing = np.minimum(earlier, (top - self.fast) / brake)
        greatest = self.fast * slowing + brake * slowing * slowing / 2.0 + top * (earlier - slowing)
        return np.maximum(self.back_m - greatest, 0.0), np.maximum(self.front_m - least, 0.0)

    def compute_future(self, seconds: Float) -> tuple[Float, Float]:
        """Return the least and the greatest station [m] so many seconds after one of these states, or a tick sooner."""
        gain, brake = self.motion.limits.acceleration, self.motion.deceleration
        top = max(self.motion.top_speed, self.fast)
        sooner = np.maximum(seconds - 0.05, 0.0)
        stopping = np.minimum(sooner, self.slow / brake)
        rising = np.minimum(seconds, (top - self.fast) / gain)
        least = self.slow * stopping - brake * stopping * stopping / 2.0
        greatest = self.fast * rising + gain * rising * rising / 2.0 + top * (seconds - rising)
        return self.back_m + least, self.front_m + greatest


@dataclass(frozen=True)
class UserReaction:
    """The drive of the other road user, and what it can change about it."""

    tables: SightTables
    keeps_course: bool = False
    """Whether it does so although it is a vehicle."""

    @property
    def reacts(self) -> bool:
        """Whether it changes its course when it sees the CAV."""
        return not self.keeps_course and bool(self.tables.record.kind[self.tables.zone.road_user] == Kind.VEHICLE)

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
        ahead, through = (
            max(float(self._way[end_tick] - self._way[seeing]), 0.0) for end_tick in (zone.enter, zone.leave)
        )
        under_root = speed * speed - 2.0 * DECELERATION * ahead
        if under_root <= 0.0:
            return True
        enter_s = since_s + (speed - math.sqrt(under_root)) / DECELERATION
        leave_s = since_s + (math.sqrt(speed * speed + 2.0 * ACCELERATION * through) - speed) / ACCELERATION
        return enter_s >= state.clear_s or leave_s - DT <= state.enter_s
