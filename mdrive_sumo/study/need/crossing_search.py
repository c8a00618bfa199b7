"""Whether a CAV without messages can cross a conflict zone safely whenever the other road user comes."""

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.study.need.approach import OVERRUN_M, ApproachState
from mdrive_sumo.study.need.doom import DoomTest
from mdrive_sumo.study.need.occluders import BIN_TICKS
from mdrive_sumo.study.need.sight_tables import SightTables

STATION_M = 0.5
"""Between stations at which speeds are told apart."""
SPEED_STEPS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Bounds of the ranges of low speeds [m/s]; above them a range is 1 m/s wide."""


@dataclass(frozen=True)
class CrossingSearch:
    """Search for a way through the states of a CAV from before a zone to behind it that avoids doomed states.

    The states are a grid of stations and speeds. A drive goes from cell to cell through sides: through one of constant
    station to the next stretch, through one of constant speed when it slows down or speeds up. A side is closed if all
    states on it are doomed at every time at which a drive through it is still in time. A drive through a side takes at
    least the time of the side, so the least over all ways of the greatest time of their sides bounds the arrival.
    """

    doom: DoomTest
    limit_s: float
    least_speed: float = 0.0
    """Drives that are slower [m/s] on the stations of the search are left out."""

    @property
    def _tables(self) -> SightTables:
        return self.doom.tables

    @cached_property
    def stations(self) -> Float:
        """(I,) stations [m] from where even the fastest can stop to the end of the zone."""
        motion, zone = self._tables.motion, self._tables.zone
        room = motion.top_speed * motion.top_speed / (2.0 * motion.deceleration)
        first = max(zone.enter_m + OVERRUN_M - room - STATION_M, 0.0)
        count = max(round((zone.leave_m - first) / STATION_M), 1)
        return np.linspace(first, zone.leave_m, count + 1)

    @cached_property
    def speeds(self) -> list[float]:
        """(J + 1,) bounds of the ranges of speeds [m/s]."""
        bounds = [self.least_speed, *(speed for speed in SPEED_STEPS if speed > self.least_speed)]
        while bounds[-1] < self._tables.motion.top_speed:
            bounds.append(float(math.floor(bounds[-1]) + 1.0))
        return bounds

    def find_crossing(self) -> float:
        """Return the least bound of the arrival time [s] of a crossing; infinite if all are late or doomed."""
        heap: list[tuple[float, int, int]] = []
        for i, j, across in self._list_entries():
            self._push(heap, 0.0, (i, j), (i, j, across))
        done: set[tuple[int, int]] = set()
        while heap:
            arrival_s, i, j = heapq.heappop(heap)
            if i == len(self.stations) - 1:
                return arrival_s
            if (i, j) in done:
                continue
            done.add((i, j))
            for cell, side in self._list_ways(i, j):
                if cell not in done:
                    self._push(heap, arrival_s, cell, side)
        return math.inf

    def _push(
        self, heap: list[tuple[float, int, int]], so_far_s: float, cell: tuple[int, int], side: tuple[int, int, bool]
    ) -> None:
        """Add the way to a cell through a side, if the side is not closed."""
        arrival_s = max(so_far_s, self._open_from(*side))
        if arrival_s <= self.limit_s:
            heapq.heappush(heap, (arrival_s, *cell))

    def _list_entries(self) -> Iterator[tuple[int, int, bool]]:
        """Yield the sides through which drives come into the grid: at its first station, or by speeding up to the
        least speed where a slower CAV could still stop."""
        yield from ((0, j, True) for j in range(len(self.speeds) - 1))
        if self.least_speed > 0.0:
            yield from ((i, 0, False) for i in range(len(self.stations) - 1) if self.stations[i] <= self.last_entry_m)

    @property
    def last_entry_m(self) -> float:
        """Last station [m] at which a CAV of the least speed can stop before the zone."""
        motion, zone = self._tables.motion, self._tables.zone
        return zone.enter_m + OVERRUN_M - self.least_speed * self.least_speed / (2.0 * motion.deceleration)

    def _list_ways(self, i: int, j: int) -> Iterator[tuple[tuple[int, int], tuple[int, int, bool]]]:
        """Yield the neighbours of a cell, each with the side that leads there."""
        yield (i + 1, j), (i + 1, j, True)
        if j > 0:
            yield (i, j - 1), (i, j, False)
        if j + 2 < len(self.speeds):
            yield (i, j + 1), (i, j + 1, False)

    @cached_property
    def _sides(self) -> dict[tuple[int, int, bool], float]:
        return {}

    def _open_from(self, i: int, j: int, across: bool) -> float:
        """Return the least arrival time [s] of drives through a side that is not closed; infinite if it is closed.

        across: the side at station i with speeds of range j; else that at speed j between the stations i and i + 1.
        """
        key = i, j, across
        if key not in self._sides:
            self._sides[key] = self._find_opening(self._build_state(i, j, across))
        return self._sides[key]

    def _build_state(self, i: int, j: int, across: bool) -> ApproachState:
        motion, zone, station = self._tables.motion, self._tables.zone, float(self.stations[i])
        if across:
            return ApproachState(motion, zone, station, station, self.speeds[j], self.speeds[j + 1])
        return ApproachState(motion, zone, station, float(self.stations[i + 1]), self.speeds[j], self.speeds[j])

    def _find_opening(self, state: ApproachState) -> float:
        if not state.is_reachable:
            return math.inf
        fastest = state.earliest_s + state.remaining_s
        if fastest > self.limit_s:
            return math.inf
        if not state.is_committed:
            return fastest
        first = math.floor(state.earliest_s / DT) // BIN_TICKS
        last = math.ceil((self.limit_s - state.remaining_s) / DT) // BIN_TICKS
        number = self._find_first_open(state, first, last)
        if number is None:
            return math.inf
        return max(fastest, number * BIN_TICKS * DT + state.remaining_s)

    def _find_first_open(self, state: ApproachState, first: int, last: int) -> int | None:
        """Return the first bin of time in which not all of these states are doomed."""
        if not self.doom.is_doomed(state, first):
            return first
        if len(self._tables.sets) > 1 or not self.doom.is_always_told:
            end = min(last, self.doom.steady_from)
            for number in range(first + 1, end + 1):
                if not self.doom.is_doomed(state, number):
                    return number
            first = max(first, end)
        # With nothing that moves, a later state can have seen only more.
        if first == last or self.doom.is_doomed(state, last):
            return None
        while last - first > 1:
            middle = (first + last) // 2
            first, last = (middle, last) if self.doom.is_doomed(state, middle) else (first, middle)
        return last
