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
LOOK_AHEAD_S = 10.0
"""A crossing is looked for until so long after the time limit, to say by how much the limit is missed."""


@dataclass(frozen=True, slots=True, order=True)
class SafeCrossing:
    """A crossing that the proof does not exclude. They have an order because a heap compares those of equal times."""

    arrival_s: float
    """Lower bound of its arrival time at the goal."""
    station: float
    """Station at which the driver is slowest because of the conflict [m]."""
    speed: float
    """Greatest speed at that station [m/s]."""


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

    def find_steady_crossing(self) -> SafeCrossing | None:
        """Return a crossing in one range of speeds in which the CAV always sees the road user in time, or None.

        A cheap test that spares the search where nothing is hidden.
        """
        for j in range(len(self.speeds) - 2, -1, -1):
            states = [self._build_state(i, j, True) for i in range(len(self.stations))]
            if not all(state.is_reachable for state in states):
                continue
            worst = max(states, key=lambda state: state.earliest_s + state.remaining_s)
            arrival_s = worst.earliest_s + worst.remaining_s
            if arrival_s <= self.limit_s and all(not s.is_committed or self.doom.sees_at_once(s) for s in states):
                return SafeCrossing(arrival_s, worst.back_m, worst.fast)
        return None

    def find_crossing(self) -> SafeCrossing | None:
        """Return the crossing with the least bound of its arrival time.

        None if all others are `LOOK_AHEAD_S` late or doomed.
        """
        heap: list[tuple[float, int, int, SafeCrossing]] = []
        for i, j, across in self._list_entries():
            self._push(heap, SafeCrossing(0.0, 0.0, 0.0), (i, j), (i, j, across))
        done: set[tuple[int, int]] = set()
        while heap:
            _, i, j, slowest = heapq.heappop(heap)
            if i == len(self.stations) - 1:
                return slowest
            if (i, j) in done:
                continue
            done.add((i, j))
            for cell, side in self._list_ways(i, j):
                if cell not in done:
                    self._push(heap, slowest, cell, side)
        return None

    def _push(
        self,
        heap: list[tuple[float, int, int, SafeCrossing]],
        slowest: SafeCrossing,
        cell: tuple[int, int],
        side: tuple[int, int, bool],
    ) -> None:
        """Add the way to a cell through a side, if the side is not closed."""
        arrival_s = self._open_from(*side)
        if math.isfinite(arrival_s):
            crossing = SafeCrossing(arrival_s, float(self.stations[side[0]]), self.speeds[side[1] + side[2]])
            worst = max(slowest, crossing, key=lambda candidate: candidate.arrival_s)
            heapq.heappush(heap, (worst.arrival_s, *cell, worst))

    def _list_entries(self) -> Iterator[tuple[int, int, bool]]:
        """Yield the sides through which drives come into the grid: at its first station, or by speeding up to the
        least speed where a slower CAV could still stop."""
        yield from ((0, j, True) for j in range(len(self.speeds) - 1))
        motion, zone = self._tables.motion, self._tables.zone
        last = zone.enter_m + OVERRUN_M - self.least_speed * self.least_speed / (2.0 * motion.deceleration)
        if self.least_speed > 0.0:
            yield from ((i, 0, False) for i in range(len(self.stations) - 1) if self.stations[i] <= last)

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
        until_s = self.limit_s + LOOK_AHEAD_S
        if fastest >= until_s:
            return math.inf
        if not state.is_committed:
            return fastest
        first = math.floor(state.earliest_s / DT) // BIN_TICKS
        last = math.ceil((until_s - state.remaining_s) / DT) // BIN_TICKS
        number = self._find_first_open(state, first, last)
        if number is None:
            return math.inf
        return max(fastest, number * BIN_TICKS * DT + state.remaining_s)

    def _find_first_open(self, state: ApproachState, first: int, last: int) -> int | None:
        """Return the first bin of time in which not all of these states are doomed."""
        if not self.doom.is_doomed(state, first):
            return first
        if len(self._tables.sets) > 1 or not self.doom.witnesses.tells_of_itself:
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
