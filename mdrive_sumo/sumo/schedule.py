"""What a vehicle of a log did, as the speed that it desires: on time where nothing disturbs it, and never a race."""

from bisect import bisect_right
from itertools import pairwise

from mdrive_sumo.scenario.traffic import Schedule
from mdrive_sumo.state import DT

CATCH_UP_S = 1.0
"""A deviation from the schedule is made good with this time constant."""
HURRY = 1.2
"""A late vehicle drives at most so many times as fast as the log did at that place."""
CRAWL = 3.0
"""Where the log stood or crept, a late vehicle may drive this fast [m/s]: it does not wait there again."""
CREEP_MPS = 0.5
"""Whoever is slower than this at the end of its schedule stood there; others are not stopped there when they are late."""
LATE_M = 2.0
"""Whoever is further behind its schedule [m] is perturbed: it takes right of way as the rules have it."""
THERE_M = 0.5
"""How near [m] to the end of its schedule a vehicle has arrived there."""


class Timetable:
    """A schedule, ready for look-ups: plain floats and bisection, once per vehicle and control step."""

    def __init__(self, schedule: Schedule) -> None:
        self._times = [time for time, _ in schedule.progress]
        self._places = [place for _, place in schedule.progress]
        moved = [(s0, (s1 - s0) / (t1 - t0)) for (t0, s0), (t1, s1) in pairwise(schedule.progress) if s1 > s0]
        self._stations = [place for place, _ in moved]
        self._speeds = [speed for _, speed in moved]
        self._moved_on = self._places[-1] - self._places[-2] > CREEP_MPS * (self._times[-1] - self._times[-2])

    @property
    def ends_s(self) -> float:
        """When it ends."""
        return self._times[-1]

    @property
    def ends_m(self) -> float:
        """Where it ends, along the route."""
        return self._places[-1]

    def place(self, time: float) -> float:
        """Where the log had the vehicle [m along the route]; before and after, where it began and ended."""
        i = bisect_right(self._times, time)
        if i == 0:
            return self._places[0]
        if i == len(self._times):
            return self._places[-1]
        t0, s0 = self._times[i - 1], self._places[i - 1]
        return s0 + (self._places[i] - s0) * (time - t0) / (self._times[i] - t0)

    def speed_at(self, place: float) -> float:
        """How fast the log drove there [m/s]; where it stood, how fast it drove on."""
        if not self._speeds:
            return 0.0
        return self._speeds[max(bisect_right(self._stations, place) - 1, 0)]

    def desired(self, time: float, place: float, step_s: float = DT) -> float:
        """The speed [m/s] to command at `time` for the next `step_s` to a vehicle that is at `place`."""
        most = max(HURRY * self.speed_at(place), CRAWL)
        if time >= self.ends_s and self._moved_on:
            return most
        ought = self.place(time)
        speed = (self.place(time + step_s) - ought) / step_s + (ought - place) / CATCH_UP_S
        return min(max(speed, 0.0), most)
