"""Clock: how an agent's computing time delays its control (protocol 12.3).

While an agent computes, its last control is applied again and it gets no observation (paper, RQ5: "the previous
control is replayed until the next action becomes available").
"""

import math
import re
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import TICKS_PER_SECOND

TICK_MS = 1000 // TICKS_PER_SECOND
"""Milliseconds of a tick: agent clocks are declared in whole ticks."""


@dataclass(frozen=True, slots=True)
class Clock:
    """How long a reply takes to apply: no time (ideal), a fixed number of ticks, or the measured wall-clock time."""

    kind: str = "ideal"
    ticks: int = 0

    @property
    def text(self) -> str:
        """The clock as `parse_clock` reads it."""
        return f"fixed:{self.ticks * TICK_MS}" if self.kind == "fixed" else self.kind

    def delay_ticks(self, think_time_s: float) -> int:
        """Return the ticks between an observation and the use of its reply, for a computing time in seconds.

        Measured time is rounded down to whole ticks, as in the original: a reply within a tick costs nothing.
        """
        return math.floor(think_time_s * TICKS_PER_SECOND) if self.kind == "measured" else self.ticks


IDEAL = Clock()


def parse_clock(text: str) -> Clock:
    """Return the clock for `ideal`, `fixed:MS` or `measured`. Raises InputError for any other text."""
    if text in ("ideal", "measured"):
        return Clock(text)
    match = re.fullmatch(r"fixed:(\d{1,6})", text)
    if not match or int(match[1]) % TICK_MS:
        raise InputError(
            f"agent clock: expected ideal, measured, or fixed:MS with a multiple of {TICK_MS} ms, found {text!r}"
        )
    return Clock("fixed", int(match[1]) // TICK_MS)
