"""RequestPace: requests of a tick go out at fixed times, whatever the agents took for the tick before.

Without a pace the next requests go out when the last answer has arrived, so every agent sees in the time of its request
how long the slowest one thought: a channel between CAVs that bypasses V2X. The pace changes the time of requests only,
no reply and no result.
"""

import math
import time
from collections.abc import Callable

from mdrive_sumo.core.errors import InputError

MAX_PACE_S = 1.0
"""Longest pace [s]: an episode of 2400 ticks then takes 40 minutes."""


class RequestPace:
    """A grid of times. Where a tick takes longer than the pace, its successor waits for the next time of the grid.

    So a late answer moves all later requests by whole multiples of the pace, and nothing finer can be seen.
    """

    def __init__(
        self,
        pace_s: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Raises InputError for a pace that is no time, or too long."""
        if not 0 < pace_s <= MAX_PACE_S:
            raise InputError(f"pace: expected more than 0 and at most {MAX_PACE_S:g} s, found {pace_s:g} s")
        self._pace_s, self._clock, self._sleep = pace_s, clock, sleep
        self._next_s: float | None = None
        self.slips = 0
        """By how many paces the requests are later than without late ticks."""

    def wait(self) -> None:
        """Wait for the time of the next requests; the first ones go out at once."""
        now_s = self._clock()
        if self._next_s is None:
            self._next_s = now_s
        missed = max(0, math.ceil((now_s - self._next_s) / self._pace_s))
        self.slips += missed
        self._next_s += missed * self._pace_s
        if self._next_s > now_s:
            self._sleep(self._next_s - now_s)
        self._next_s += self._pace_s


def make_pace(pace_s: float) -> RequestPace | None:
    """Return the pace, None for 0. Raises InputError."""
    return RequestPace(pace_s) if pace_s else None
