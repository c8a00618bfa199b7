"""TickClock: when the next tick of a drive is due, in real time."""

import time
from collections import deque
from collections.abc import Callable

from mdrive_sumo.core.state import DT

MAX_CATCH_UP_S = 0.1
"""How far ticks that were late may be caught up with shorter ones [s]: two ticks. What is later than that slows the
drive down, because a car that jumps ahead of its driver cannot be steered."""
WINDOW_TICKS = 40
"""The factor is that of the last 2 s: long enough to be steady, short enough to show a hiccup."""
SLOW_FACTOR, STEADY_FACTOR = 0.95, 0.99
"""Below the first the drive is called slower than real time, from the second on no longer. What can be caught up, 0.1 s
of the 2 s, says nothing of the machine."""


class TickClock:
    """A grid of 50 ms, on which every tick is due after the one before: none is skipped, however late it is."""

    def __init__(self, speed_up: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        """speed_up: how many times faster than real time it runs, for drivers that are programs."""
        self._clock = clock
        self._tick_s, self._catch_up_s = DT / speed_up, MAX_CATCH_UP_S / speed_up
        self._due_s = clock()
        self._begun: deque[float] = deque(maxlen=WINDOW_TICKS + 1)
        self._is_slow = False

    def start(self) -> None:
        """Let the first tick be due now, after a pause."""
        self._due_s = self._clock()
        self._begun.clear()
        self._is_slow = False

    @property
    def wait_s(self) -> float:
        """Time until the tick is due [s]; 0 if it is late."""
        return max(0.0, self._due_s - self._clock())

    def begin_tick(self) -> None:
        """Begin a tick now; the next one is due 50 ms after this one was, or later if this one is too late."""
        now_s = self._clock()
        self._begun.append(now_s)
        self._due_s = max(self._due_s, now_s - self._catch_up_s) + self._tick_s
        if len(self._begun) > WINDOW_TICKS:
            self._is_slow = self.factor < (STEADY_FACTOR if self._is_slow else SLOW_FACTOR)

    @property
    def factor(self) -> float:
        """Simulated time by real time (times the speed-up) in the last 2 s, at most 1; 1 before there are two ticks."""
        if len(self._begun) < 2:
            return 1.0
        real_s = self._begun[-1] - self._begun[0]
        return min(1.0, (len(self._begun) - 1) * self._tick_s / real_s) if real_s > 0 else 1.0

    @property
    def is_slow(self) -> bool:
        """Whether the drive is slower than real time."""
        return self._is_slow
