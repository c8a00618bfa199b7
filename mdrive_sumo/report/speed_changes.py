"""Standing and braking, found in the speeds of a car."""

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import TICKS_PER_SECOND

STANDING_SPEED = 0.1
"""[m/s] A slower car stands: controllers leave some centimetres a second (measured: a car that waits with `single`)."""
BRAKING_PAUSE_TICKS = TICKS_PER_SECOND // 2
"""Braking that goes on after at most such a pause is one manoeuvre: agents decide 2 to 5 times a second."""


def list_runs(mask: Bool) -> list[tuple[int, int]]:
    """Return the first and the last tick of each run of True in a mask (T,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).tolist()
    return [(first, end - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def keep_long(mask: Bool, ticks: int) -> Bool:
    """Return a mask (T,) without its runs of True shorter than `ticks`."""
    kept = mask.copy()
    for first, last in list_runs(mask):
        if last - first + 1 < ticks:
            kept[first : last + 1] = False
    return kept


def list_brakings(speed: Float) -> list[tuple[int, int]]:
    """Return first and last tick of each manoeuvre in which the speed (T,) [m/s] falls, short pauses included."""
    found: list[tuple[int, int]] = []
    for first, last in list_runs(np.diff(speed, append=speed[-1:]) < 0):
        pause = found and first - found[-1][1] <= BRAKING_PAUSE_TICKS
        if pause and speed[first] <= speed[found[-1][1]] + STANDING_SPEED:
            found[-1] = found[-1][0], last + 1
        else:
            found.append((first, min(last + 1, len(speed) - 1)))
    return [(first, min(last, len(speed) - 1)) for first, last in found]


def cut_standing(first: int, last: int, stands: Bool) -> tuple[int, int]:
    """Return the ticks of a braking before the car stands."""
    still = np.flatnonzero(stands[first : last + 1])
    return (first, first + int(still[0]) - 1) if len(still) else (first, last)
