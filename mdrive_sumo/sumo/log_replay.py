"""Background vehicles on their log: all the time (`replay`), or until a CAV changes the situation (`hybrid`)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.sumo.conflict import Mover, meets, mover_of
from mdrive_sumo.sumo.insertion import Berth, berth_at
from mdrive_sumo.sumo.logged_poses import logs_of

STRAY_M = 1.0
"""A released vehicle that is so far from where its log has it changes the situation of others too."""


class Replay:
    """Who follows its log now. One object an episode."""

    def __init__(self, background: Background, roads: RoadMap) -> None:
        self._logs = logs_of(background.vehicles if background.mode != "reactive" else ())
        self._roads = roads
        self._following = np.ones(len(self._logs.vehicles), dtype=np.bool_)
        self.releases = background.mode == "hybrid" and bool(self._logs.vehicles)
        """Whether anybody can be released."""
        self._last = Actors.empty()

    def actors(self, tick: int) -> Actors:
        """Those that are on their log in a tick."""
        if not len(self._following):
            return self._last
        found = self._logs.actors(tick, self._following)
        if found.ids == self._last.ids:
            found = replace(found, ids=self._last.ids)
        self._last = found
        return found

    def released(self, tick: int, cavs: Sequence[Mover], last: Actors) -> list[tuple[BackgroundVehicle, Berth]]:
        """Vehicles that leave their log for good, and where: it leads into a CAV, or into one that left its own.

        `last`: all background vehicles in the tick before. Who is off its route then stays on its log.
        """
        found: list[tuple[BackgroundVehicle, Berth]] = []
        for i in np.flatnonzero(self._disturbed(tick, [*cavs, *self._strays(tick - 1, last)])):
            vehicle = self._logs.vehicles[i]
            pose, is_new = self._logs.pose(vehicle, tick), self._logs.pose(vehicle, tick - 1) is None
            berth = berth_at(vehicle, pose, tick, is_new, self._roads) if pose else None
            if berth is not None:
                self._following[i] = False
                found.append((vehicle, berth))
        return found

    def _disturbed(self, tick: int, movers: Sequence[Mover]) -> Bool:
        """Which vehicles (V,) follow their log into a mover."""
        if tick >= self._logs.present.shape[1]:
            return np.zeros_like(self._following)
        there = self._following & self._logs.present[:, tick]
        met = np.zeros_like(there)
        for mover in movers:
            met |= meets(self._logs, tick, there & ~met, mover)
        return met

    def _strays(self, tick: int, last: Actors) -> Iterator[Mover]:
        """Released vehicles that are no longer where their log has them."""
        released = {self._logs.vehicles[i].id: self._logs.vehicles[i] for i in np.flatnonzero(~self._following)}
        for i, name in enumerate(last.ids if released else ()):
            if name not in released:
                continue
            pose = self._logs.pose(released[name], tick)
            if pose is None or math.hypot(last.x[i] - pose.x, last.y[i] - pose.y) > STRAY_M:
                yield mover_of(last, i, off_log=True)
