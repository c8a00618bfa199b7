"""How to pass behind those who go first: the exact space-time plan around what the others have announced.

The planner of `omniscient` with a shorter horizon, fed with messages and sensors instead of the truth.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.agents.negotiation.intention import AFTER_S, POINTS
from mdrive_sumo.agents.overlap import CHECK_MARGIN, PLAN_MARGIN, Margin, cells_of, footprints, overlaps
from mdrive_sumo.agents.path import SPACING_M, Path, curve_speeds, make_path
from mdrive_sumo.agents.space_time import SAMPLES, STEP_S, Profile, Task, braking, fastest, task_along
from mdrive_sumo.contract import Briefing, Plan
from mdrive_sumo.geometry import Bool, Float, Int, boxes_corners

HORIZON_S = 10.0
REVIEW_TICKS = 10
"""A profile is made anew where it is on the lattice of its own: every half second."""
CHECK_TICKS = 2
CHECK_S = 3.0
LATERAL, BRAKING = 3.0, 2.0
SPARE_S = 1.0
INTERVAL_S = 0.2
ANNOUNCED = 50
ASTRAY_M = 0.8
CELLS = 2
"""Footprints are compared at every second cell and every second sample."""


@dataclass(frozen=True)
class Motion:
    """Where somebody will be: box centres and directions (T, 3) at the times of `TIMES`, and the box's size [m]."""

    poses: Float
    length: float
    width: float


TIMES: Float = (
    np.arange(1, round(HORIZON_S / STEP_S) * SAMPLES // CELLS + 1, dtype=np.float64) * STEP_S / SAMPLES * CELLS
)
"""(T,) [s] from now."""


class Passage:
    """The own way, and when to be where on it."""

    def __init__(self, briefing: Briefing, start_yaw: float, cruise: float) -> None:
        self._me = briefing
        self.path: Path = make_path(briefing.route_xy, briefing.vehicle.rear_to_centre, start_yaw)
        stations = np.linspace(0.0, self.path.length, len(self.path.xy))
        legal = np.interp(stations, briefing.route_s, briefing.route_speed_limit)
        self._speeds = np.minimum(curve_speeds(self.path, cruise, LATERAL, BRAKING), legal)
        self._profile: Profile | None = None
        self._made_tick = 0
        self.s = 0.0

    def follow(self, x: float, y: float) -> None:
        """Takes notice of the measured box centre [m]."""
        self.s = self.path.project(x, y, self.s)

    def update(self, tick: int, speed: float, motions: Sequence[Motion], stop_s: float = math.inf) -> None:
        """Makes a new profile if it is time to, or if the present one has become unsafe. stop_s: where to stop [m]."""
        age_ticks = tick - self._made_tick
        stale = self._profile is None or not self._on_course(tick)
        if stale:
            self._profile = self._made(tick, (self.s, speed), motions, stop_s)
            self._made_tick = tick
            return
        assert self._profile is not None
        if age_ticks % REVIEW_TICKS == 0:
            layer = min(age_ticks // REVIEW_TICKS, len(self._profile.s) - 1)
            start = float(self._profile.s[layer]), float(self._profile.speed[layer])
        elif age_ticks % CHECK_TICKS == 0 and self._unsafe(tick, motions):
            start = self.s, speed
        else:
            return
        self._profile, self._made_tick = self._made(tick, start, motions, stop_s), tick

    def _on_course(self, tick: int) -> bool:
        assert self._profile is not None
        return abs(self._station(tick, np.zeros(1))[0] - self.s) <= ASTRAY_M

    def _station(self, tick: int, after: Float) -> Float:
        assert self._profile is not None
        return self._profile.at((tick - self._made_tick) * self._me.tick_s + after)

    def _unsafe(self, tick: int, motions: Sequence[Motion]) -> bool:
        count = int(CHECK_S / (STEP_S / SAMPLES * CELLS))
        cells = cells_of(self.path, self._station(tick, TIMES[:count]))
        met = np.zeros(count, dtype=np.bool_)
        for motion in motions:
            near = self._met(cells, motion, CHECK_MARGIN, count)
            met |= np.diagonal(near)
        return bool((met & ~np.logical_and.accumulate(met)).any())

    def _met(self, cells: Int, motion: Motion, margin: Margin, count: int) -> Bool:
        """(count, J) whether I touch somebody at the times and cells."""
        vehicle, poses = self._me.vehicle, motion.poses[:count]
        mine = footprints(self.path, vehicle.length + 2 * margin.along, vehicle.width + 2 * margin.across, cells)
        length, width = np.asarray(motion.length), np.asarray(motion.width)
        theirs = boxes_corners(poses[:, 0], poses[:, 1], poses[:, 2], length, width)
        return overlaps(mine, theirs).T

    def _made(self, tick: int, start: tuple[float, float], motions: Sequence[Motion], stop_s: float) -> Profile:
        task = self._task(tick, start)
        task = task.among(lambda margin: self._blocked(task, motions, stop_s, margin))
        return fastest(task) or braking(task)

    def _task(self, tick: int, start: tuple[float, float]) -> Task:
        now_s = tick * self._me.tick_s
        task = task_along(self.path, self._speeds, start, now_s, now_s + HORIZON_S + 1e-6)
        reach = int(HORIZON_S * 10 / SPACING_M)
        if len(task.cells) > reach:
            task = replace(task, cells=task.cells[:reach], limits=task.limits[:reach], blocked=task.blocked[:, :reach],
                           goals=slice(min(task.goals.start, reach - 1), None))  # fmt: skip
        return task

    def _blocked(self, task: Task, motions: Sequence[Motion], stop_s: float, margin: Margin) -> Bool:
        blocked = np.zeros_like(task.blocked)
        cells = task.cells[::CELLS]
        for motion in motions:
            met = self._met(cells, motion, margin, len(TIMES))
            if met.any():
                blocked |= np.repeat(np.repeat(met, CELLS, axis=1)[:, : blocked.shape[1]], CELLS, axis=0)
        if math.isfinite(stop_s):
            blocked[:, max(math.ceil((stop_s - task.start_s) / SPACING_M), 1) :] = True
        return blocked

    def plan(self, tick: int) -> Plan:
        """The profile from now on."""
        return Plan(self.planned(tick), INTERVAL_S)

    def planned(self, tick: int) -> Float:
        """(`ANNOUNCED`, 2) where I mean to be every `INTERVAL_S`."""
        after = np.arange(1, ANNOUNCED + 1, dtype=np.float64) * INTERVAL_S
        return self.path.points(self._station(tick, after))

    def desired(self, speed: float) -> Float:
        """(`POINTS`, 2) where I would be on a free road."""
        s, stations = self.s, np.zeros(POINTS)
        for k in range(POINTS):
            limit = float(self._speeds[min(int(s / SPACING_M), len(self._speeds) - 1)])
            after = min(speed + 2.0 * float(AFTER_S[0]), max(limit, speed - 4.0 * float(AFTER_S[0])))
            s += (speed + after) / 2 * float(AFTER_S[0])
            speed = after
            stations[k] = s
        return self.path.points(stations)


__all__ = ["PLAN_MARGIN", "TIMES", "Motion", "Passage"]
