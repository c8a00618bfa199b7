"""The planner of the cooperative baselines: the exact space-time plan around where the others are expected.

The search of `omniscient` with a shorter horizon, fed with what was seen and heard instead of the truth.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.contract import Briefing, OwnState, Plan
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.planning.motion_prediction import HORIZON_S, SPARSE, STANDING_SPEED, TIMES, Motion
from mdrive_sumo.planning.path import SPACING_M, Path, curve_speeds, make_path
from mdrive_sumo.planning.path_overlap import CHECK_MARGIN, Margin, cells_of, footprints, overlaps
from mdrive_sumo.planning.speed_profile import TOP_SPEED, Profile, Task, braking, fastest, task_along

REVIEW_TICKS = 10
"""A profile is made anew where it is on the lattice of its own: every half second."""
CHECK_TICKS = 4
"""It is looked at that often, at 5 Hz as the paper's planners decide."""
CHECK_S = 3.0
LATERAL, BRAKING = 3.0, 2.0
"""Comfort in bends and before them [m/s2]."""
LEAST_MARGIN = Margin(0.5, 0.1)
"""Kept where the whole margin is violated already: one who stands behind another does not creep up to it."""
HASTE = 0.05
"""See `Task.haste`: who must wait behind somebody moves up now, not at the last moment."""
PATIENT_TICKS = 40
TIGHT_MARGIN = Margin(0.5, 0.1)
"""Of one who has stood for so long: two who wait close to each other must find a way past."""
INTERVAL_S = 0.2
PLAN_POINTS = 50
ASTRAY_M = 0.8
"""A car that is so far from where its profile has it makes a new one."""
REACH = round(HORIZON_S * TOP_SPEED / SPACING_M)
"""Cells that the horizon can reach."""


@dataclass(frozen=True, slots=True)
class Barrier:
    """A place on the path that must not be passed by the box centre for some time [s from now]."""

    s: float
    until_s: float = math.inf


class Planner:
    """The own way, and when to be where on it."""

    def __init__(self, briefing: Briefing, start_yaw: float, cruise: float) -> None:
        self._me = briefing
        self.path: Path = make_path(briefing.route_xy, briefing.vehicle.rear_to_centre, start_yaw)
        self._cruise = cruise
        self._speeds = self._allowed()
        self._profile: Profile | None = None
        self._made_tick = self._moved_tick = 0
        self.s = 0.0

    def _allowed(self) -> Float:
        """(M,) [m/s] at the points of the path: what is legal and comfortable."""
        stations = np.linspace(0.0, self.path.length, len(self.path.xy))
        legal = np.interp(stations, self._me.route_s, self._me.route_speed_limit)
        return np.minimum(curve_speeds(self.path, self._cruise, LATERAL, BRAKING), legal)

    def divert(self, path: Path) -> None:
        """Goes on along another path, which begins as the present one does."""
        x, y = self.path.points(np.array((self.s,)))[0].tolist()
        self.path, self.s = path, path.project(x, y, self.s)
        self._speeds, self._profile = self._allowed(), None

    def follow(self, tick: int, own: OwnState) -> None:
        """Takes notice of the measured state."""
        self.s = self.path.project(own.x, own.y, self.s)
        if abs(own.speed) > STANDING_SPEED:
            self._moved_tick = tick

    def due(self, tick: int) -> bool:
        """Whether `update` wants to be called in this tick."""
        age = tick - self._made_tick
        return self._profile is None or age % REVIEW_TICKS == 0 or age % CHECK_TICKS == 0 or not self._on_course(tick)

    def update(self, tick: int, speed: float, motions: Sequence[Motion], barriers: Sequence[Barrier] = ()) -> None:
        """Makes a new profile if it is time to, or if the present one has become unsafe."""
        profile = self._profile
        if profile is None or not self._on_course(tick):
            start = self.s, speed
        elif (tick - self._made_tick) % REVIEW_TICKS == 0:
            layer = min((tick - self._made_tick) // REVIEW_TICKS, len(profile.s) - 1)
            start = float(profile.s[layer]), float(profile.speed[layer])
        elif self._unsafe(tick, motions):
            start = self.s, speed
        else:
            return
        self._profile, self._made_tick = self._made(tick, start, motions, barriers), tick

    def _on_course(self, tick: int) -> bool:
        return abs(self._stations(tick, np.zeros(1))[0] - self.s) <= ASTRAY_M

    def _stations(self, tick: int, after: Float) -> Float:
        assert self._profile is not None, "a profile is made before anything asks for it"
        return self._profile.at((tick - self._made_tick) * self._me.tick_s + after)

    def _unsafe(self, tick: int, motions: Sequence[Motion]) -> bool:
        """Whether the profile meets somebody within `CHECK_S`; a margin that is violated already was meant."""
        count = int(CHECK_S / TIMES[0])
        cells = cells_of(self.path, self._stations(tick, TIMES[:count]))
        met = np.zeros(count, dtype=np.bool_)
        for motion in motions:
            met |= np.diagonal(self._met(cells, motion, CHECK_MARGIN)[:count])
        return bool((met & ~np.logical_and.accumulate(met)).any())

    def _met(self, cells: Int, motion: Motion, margin: Margin) -> Bool:
        """(T, J) whether a car in cell j touches somebody at time t."""
        vehicle, poses = self._me.vehicle, motion.poses
        mine = footprints(self.path, vehicle.length + 2 * margin.along, vehicle.width + 2 * margin.across, cells)
        length, width = np.asarray(motion.length), np.asarray(motion.width)
        theirs = boxes_corners(poses[:, 0], poses[:, 1], poses[:, 2], length, width)
        met = np.zeros((len(TIMES), len(cells)), dtype=np.bool_)
        met[: len(poses)] = overlaps(mine, theirs).T
        if motion.stands:
            met[len(poses) :] = met[len(poses) - 1]
        return met

    def _made(
        self, tick: int, start: tuple[float, float], motions: Sequence[Motion], barriers: Sequence[Barrier]
    ) -> Profile:
        task = self._task(tick, start)
        if tick - self._moved_tick > PATIENT_TICKS:
            return fastest(replace(task, blocked=self._blocked(task, motions, barriers, TIGHT_MARGIN))) or braking(task)
        task = task.among(lambda margin: self._blocked(task, motions, barriers, margin), LEAST_MARGIN)
        return fastest(task) or braking(task)

    def _task(self, tick: int, start: tuple[float, float]) -> Task:
        now_s = tick / TICKS_PER_SECOND
        task = task_along(self.path, self._speeds, start, now_s, now_s + HORIZON_S + 1e-6)
        cut = slice(REACH)
        return replace(
            task,
            cells=task.cells[cut],
            limits=task.limits[cut],
            blocked=task.blocked[:, cut],
            goals=slice(min(task.goals.start, REACH), None),
            haste=HASTE,
            moving=np.zeros_like(task.moving),  # who must wait waits, for as long as it takes
        )

    def _blocked(self, task: Task, motions: Sequence[Motion], barriers: Sequence[Barrier], margin: Margin) -> Bool:
        """As `Task.blocked`."""
        cells = task.cells[::SPARSE]
        met = np.zeros((len(TIMES), len(cells)), dtype=np.bool_)
        for motion in motions:
            met |= self._met(cells, motion, margin)
        blocked = np.repeat(np.repeat(met, SPARSE, axis=0), SPARSE, axis=1)[:, : len(task.cells)]
        for barrier in barriers:
            cell = max(math.ceil((barrier.s - task.start_s) / SPACING_M), 1)
            blocked[task.times <= barrier.until_s, cell:] = True
        return blocked

    def desired(self, speed: float, points: int) -> Float:
        """(points, 2) where I would be every `INTERVAL_S` on a free road [m], from that speed [m/s] on."""
        stations = np.zeros(points)
        s = self.s
        for k in range(points):
            limit = float(self._speeds[min(int(s / SPACING_M), len(self._speeds) - 1)])
            after = min(speed + BRAKING * INTERVAL_S, max(limit, speed - 2 * BRAKING * INTERVAL_S))
            s += (speed + after) / 2 * INTERVAL_S
            speed = after
            stations[k] = s
        return self.path.points(stations)

    def plan(self, tick: int) -> Plan:
        """The profile from now on."""
        return Plan(self.planned(tick), INTERVAL_S)

    def planned(self, tick: int) -> Float:
        """(`PLAN_POINTS`, 2) where I mean to be every `INTERVAL_S` [m]."""
        after = np.arange(1, PLAN_POINTS + 1, dtype=np.float64) * INTERVAL_S
        return self.path.points(self._stations(tick, after))
