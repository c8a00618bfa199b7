"""States of a CAV on its way to a conflict zone, and what it can do before and after them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.study.need.conflict_zone import ConflictZone
from mdrive_sumo.study.need.motion import RouteMotion

OVERRUN_M = 0.25
"""A CAV that can stop no further than this inside a zone counts as able to stop before it."""


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
        first, last = (int(at / (self.motion.stations[1])) for at in (self.back_m, self.front_m))
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
