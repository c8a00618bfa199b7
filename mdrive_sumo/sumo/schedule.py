"""What a vehicle of a log did, as the speed that it desires: on time where nothing disturbs it, and never a race."""

import math
from bisect import bisect_right

import numpy as np

from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.background import Schedule

ACTION_TICKS = 4
"""Vehicles with a schedule act every 0.2 s: measured, they follow it best so (0.1 s: 0.4 m off at most, 0.5 s: 3 m)."""
CATCH_UP_S = 0.5
"""A deviation from the schedule is made good with this time constant."""
HURRY = 1.2
"""A late vehicle drives at most so many times as fast as the log did at that place."""
CRAWL = 3.0
"""Where the log stood or crept, a late vehicle may drive this fast [m/s]: it does not wait there again."""
CREEP_MPS = 0.5
"""Whoever is slower than this at the end of its schedule stood there; others do not stop there when they are late."""
ON_TIME_M = 0.5
"""Nearer than this to its schedule a vehicle drives as the log did."""
LATE_M = 2.0
"""Whoever is further behind its schedule [m] is perturbed: it takes right of way as the rules have it."""
THERE_M = 0.5
"""How near [m] to the end of its schedule a vehicle has arrived there."""


class Timetable:
    """A schedule, ready for look-ups: plain floats, by tick and by place."""

    def __init__(self, schedule: Schedule) -> None:
        times, places = np.array(schedule.progress).T
        ticks = np.arange(math.ceil(times[-1] / DT - 1e-6) + 1)
        self._at: list[float] = np.interp(ticks * DT, times, places).tolist()
        rates = np.diff(places) / np.diff(times)
        moving = rates > 0.0
        self._stations: list[float] = places[:-1][moving].tolist()
        self._speeds: list[float] = rates[moving].tolist()
        self._moved_on = bool(rates[-1] > CREEP_MPS)
        self.ends_tick = len(self._at) - 1
        self.ends_m = float(places[-1])

    def place(self, tick: int) -> float:
        """Where the log had the vehicle in a tick [m along the route]; before and after, where it began and ended."""
        return self._at[min(max(tick, 0), self.ends_tick)]

    def speed_at(self, place: float) -> float:
        """How fast the log drove there [m/s]; where it stood, how fast it drove on."""
        if not self._speeds:
            return 0.0
        return self._speeds[max(bisect_right(self._stations, place) - 1, 0)]

    def desired(self, tick: int, place: float, ticks: int = ACTION_TICKS) -> float:
        """The speed [m/s] to command from `tick` on for some ticks to a vehicle that is at `place`."""
        ought = self.place(tick)
        late = ought - place
        speed = max((self.place(tick + ticks) - ought) / (ticks * DT) + late / CATCH_UP_S, 0.0)
        if -ON_TIME_M < late < ON_TIME_M and tick < self.ends_tick:
            return speed
        most = max(HURRY * self.speed_at(place), CRAWL)
        return most if tick >= self.ends_tick and self._moved_on else min(speed, most)
