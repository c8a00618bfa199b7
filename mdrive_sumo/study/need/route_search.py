"""Least arrival time of a CAV without messages that is safe against every hidden road user of its whole route."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.study.need.approach import OVERRUN_M, ApproachState
from mdrive_sumo.study.need.doom import DoomTest
from mdrive_sumo.study.need.message_lead import ReferenceDrive
from mdrive_sumo.study.need.motion import STEP_M
from mdrive_sumo.study.need.occluders import BIN_TICKS
from mdrive_sumo.study.need.speed_grid import SpeedGrid

MOST_BINS = 10
"""A doomed state counts as open after so many bins of time (5 s), whatever is true then, unless it is doomed for
good."""


ROUND_S, MOST_ROUNDS = 0.5, 16
"""A search first looks for ways that are hardly later than on a free road, and spares to judge the states of others;
after some rounds it looks for all. Chosen by time: half a second is about what one conflict costs."""


class WayPoint(NamedTuple):
    """Where a drive passes a station."""

    step: int
    cell: int
    """Of its speed."""
    time_s: float


@dataclass(frozen=True)
class ZoneStates:
    """The states of a grid at the stations before and in one conflict zone."""

    grid: SpeedGrid
    doom: DoomTest
    reference: ReferenceDrive

    @cached_property
    def steps(self) -> range:
        """The stations, as numbers of steps, from where even the fastest can stop to the end of the zone."""
        motion, zone = self.grid.motion, self.doom.tables.zone
        room = motion.top_speed * motion.top_speed / (2.0 * motion.deceleration)
        first = max(math.floor((zone.enter_m + OVERRUN_M - room) / STEP_M), 1)
        return range(first, min(math.floor(zone.leave_m / STEP_M), self.grid.steps) + 1)

    def delay(self, step: int, times: Float) -> Float:
        """Return (C,) the least times [s] at a station at which no state is doomed that comes there by those (C,)."""
        if step not in self.steps:
            return times
        ranges = self.grid.ranges
        delayed = times.copy()
        for number, first_s in enumerate(np.minimum.reduceat(times, ranges[:-1]).tolist()):
            if math.isfinite(first_s) and (opening_s := self._find_opening(step, number, first_s)) > first_s:
                cells = slice(ranges[number], ranges[number + 1])
                delayed[cells] = np.maximum(times[cells], opening_s)
        return delayed

    def _find_opening(self, step: int, number: int, first_s: float) -> float:
        """Return a time [s] before which all states of a range are doomed, from the given time on; it or less if
        they are not."""
        state = self._build_state(step, number)
        if not state.is_committed:
            return first_s
        first = _find_bin(first_s)
        if not self._is_doomed(step, number, first):
            return first_s
        if self._is_doomed(step, number, self._last_bin):
            return math.inf
        end = min(first + MOST_BINS, self._last_bin)
        opening = next((later for later in range(first + 1, end) if not self._is_doomed(step, number, later)), end)
        return opening * BIN_TICKS * DT

    @cached_property
    def _last_bin(self) -> int:
        """A bin in which only what stands for good has hidden anything; what is doomed in it was doomed before."""
        return self.doom.steady_from + _find_bin(self.grid.motion.fastest_times[-1])

    def meets(self, way: Sequence[WayPoint]) -> bool:
        """Return whether a drive is doomed somewhere on its way."""
        return any(
            self._find_opening(point.step, self.grid.find_range(point.cell), point.time_s) > point.time_s
            for point in way
            if point.step in self.steps
        )

    @property
    def is_told(self) -> bool:
        """Whether a message can tell of the road user in time in the reference drive."""
        return self.reference.is_told

    @cached_property
    def _states(self) -> dict[tuple[int, int], ApproachState]:
        return {}

    def _build_state(self, step: int, number: int) -> ApproachState:
        if (step, number) not in self._states:
            slow, fast = self.grid.bounds[self.grid.ranges[number : number + 2]].tolist()
            tables, station = self.doom.tables, step * STEP_M
            self._states[step, number] = ApproachState(tables.motion, tables.zone, station, station, slow, fast)
        return self._states[step, number]

    @cached_property
    def _doomed(self) -> dict[tuple[int, int, int], bool]:
        return {}

    def _is_doomed(self, step: int, number: int, time_bin: int) -> bool:
        key = step, number, time_bin
        if key not in self._doomed:
            self._doomed[key] = self.doom.is_doomed(self._build_state(step, number), time_bin)
        return self._doomed[key]


@dataclass(frozen=True, slots=True)
class SafeArrival:
    """The least arrival time that is found."""

    time_s: float
    """Infinite if no drive is safe."""
    road_users: frozenset[int]
    """Columns of those that the bound rests on."""


def find_safe_arrival(grid: SpeedGrid, zones: Sequence[ZoneStates]) -> SafeArrival:
    """Return a lower bound of when a drive arrives that passes no doomed state of any zone.

    Zones are added one by one: as long as the fastest way past the zones so far passes doomed states of another one.
    """
    chosen: list[ZoneStates] = []
    left = list(zones)
    search = _Search(grid, chosen)
    while True:
        rows = search.run()
        arrival_s = float(rows[-1].min())
        if not math.isfinite(arrival_s):
            return SafeArrival(arrival_s, frozenset(zone.doom.tables.zone.road_user for zone in chosen))
        way = list(_trace(grid, rows))
        met = next((zone for zone in left if zone.meets(way) and zone.is_told), None)
        if met is None:
            return SafeArrival(arrival_s, frozenset(zone.doom.tables.zone.road_user for zone in chosen))
        chosen.append(met)
        left.remove(met)


def find_free_way(grid: SpeedGrid) -> tuple[WayPoint, ...]:
    """Return the fastest way on a free road, from the goal back to the start."""
    return tuple(_trace(grid, _Search(grid, ()).run()))


@dataclass
class _Search:
    """The least times past the doomed states of some zones, of which more are added from run to run."""

    grid: SpeedGrid
    zones: Sequence[ZoneStates]
    until_s: float = 0.0
    """Ways that are later than this [s] at the goal are left out; it is raised until one is found."""

    @cached_property
    def _remaining(self) -> list[Float]:
        """(C,) least time [s] to the goal on a free road from every cell of speed at each station."""
        rows = [np.zeros(len(self.grid.bounds) - 1)]
        for step in range(self.grid.steps - 1, -1, -1):
            rows.append(self.grid.go_back(rows[-1], step))
        return rows[::-1]

    def run(self) -> list[Float]:
        """Return (C,) the least time [s] in every cell of speed at each station."""
        if not self.zones:
            return self._advance()
        self.until_s = max(self.until_s, float(self._remaining[0][self.grid.find_cell(self.grid.motion.start_speed)]))
        for _ in range(MOST_ROUNDS):
            rows = self._advance()
            if math.isfinite(float(rows[-1].min())):
                return rows
            self.until_s += ROUND_S
        self.until_s = math.inf
        return self._advance()

    def _advance(self) -> list[Float]:
        rows = [self.grid.start()]
        for step in range(1, self.grid.steps + 1):
            times = self.grid.advance(rows[-1], step - 1)
            if self.zones and math.isfinite(self.until_s):
                times[times + self._remaining[step] > self.until_s + 1e-6] = np.inf
            for zone in self.zones:
                times = zone.delay(step, times)
            rows.append(times)
        return rows


def _trace(grid: SpeedGrid, rows: Sequence[Float]) -> Iterator[WayPoint]:
    """Yield the fastest way, from the goal back to the start."""
    cell = int(rows[-1].argmin())
    for step in range(grid.steps, 0, -1):
        yield WayPoint(step, cell, float(rows[step][cell]))
        cell = grid.find_begin(rows[step - 1], step - 1, cell)


def _find_bin(time_s: float) -> int:
    return math.floor(time_s / DT + 1e-9) // BIN_TICKS
