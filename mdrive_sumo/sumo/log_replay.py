"""Background vehicles that replay their log: always (`replay`), or until a CAV disturbs them (`hybrid`)."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.sumo.conflict import MovingBox, build_moving_box, find_conflicts
from mdrive_sumo.sumo.insertion import InsertionPoint, find_takeover_point
from mdrive_sumo.sumo.logged_poses import build_logged_poses

STRAY_M = 1.0
"""A released vehicle this far [m] from its logged position disturbs others."""


class LogReplay:
    """The background vehicles of one episode that follow their log."""

    def __init__(self, background: Background, roads: RoadMap) -> None:
        self._logged = build_logged_poses(background.vehicles if background.mode != "reactive" else ())
        self._roads = roads
        self._is_following = np.ones(len(self._logged.vehicles), dtype=np.bool_)
        self.can_release = background.mode == "hybrid" and bool(self._logged.vehicles)
        """Whether vehicles can be released from their log."""
        self._last = Actors.empty()

    def actors(self, tick: int) -> Actors:
        """Return the vehicles that are on their log in a tick."""
        if not len(self._is_following):
            return self._last
        actors = self._logged.actors(tick, self._is_following)
        if actors.ids == self._last.ids:
            actors = replace(actors, ids=self._last.ids)
        self._last = actors
        return actors

    def release_disturbed(
        self, tick: int, cavs: Sequence[MovingBox], last: Actors
    ) -> list[tuple[BackgroundVehicle, InsertionPoint]]:
        """Release the vehicles whose log leads into a CAV or into a released vehicle; return their insertion points.

        `last`: all background vehicles in the last tick. A vehicle that is off its route stays on its log.
        """
        released: list[tuple[BackgroundVehicle, InsertionPoint]] = []
        for i in np.flatnonzero(self._find_disturbed(tick, [*cavs, *self._find_strays(tick - 1, last)])):
            vehicle = self._logged.vehicles[i]
            pose, is_new = self._logged.find_pose(vehicle, tick), self._logged.find_pose(vehicle, tick - 1) is None
            point = find_takeover_point(vehicle, pose, tick, is_new, self._roads) if pose else None
            if point is not None:
                self._is_following[i] = False
                released.append((vehicle, point))
        return released

    def _find_disturbed(self, tick: int, movers: Sequence[MovingBox]) -> Bool:
        """Return a (V,) mask of the vehicles whose log leads into a mover."""
        if tick >= self._logged.present.shape[1]:
            return np.zeros_like(self._is_following)
        is_candidate = self._is_following & self._logged.present[:, tick]
        in_conflict = np.zeros_like(is_candidate)
        for mover in movers:
            in_conflict |= find_conflicts(self._logged, tick, is_candidate & ~in_conflict, mover)
        return in_conflict

    def _find_strays(self, tick: int, last: Actors) -> Iterator[MovingBox]:
        """Yield the released vehicles that are no longer at their logged position."""
        released = {self._logged.vehicles[i].id: self._logged.vehicles[i] for i in np.flatnonzero(~self._is_following)}
        for i, name in enumerate(last.ids if released else ()):
            if name not in released:
                continue
            pose = self._logged.find_pose(released[name], tick)
            if pose is None or portable.hypot(last.x[i] - pose.x, last.y[i] - pose.y) > STRAY_M:
                yield build_moving_box(last, i, off_log=True)
