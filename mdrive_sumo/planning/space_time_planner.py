"""The planner of the cooperative baselines: an exact space-time search around predicted motions.

It uses the search of `omniscient` (`speed_profile`) with a shorter horizon, and predictions instead of the truth.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, OwnState, Plan, Reason
from mdrive_sumo.contract.exchange import OUR_CONTROLLER
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.planning.free_drive import drive_freely, falls_behind, predict_free_stations, round_limits
from mdrive_sumo.planning.motion_conflicts import MotionConflicts
from mdrive_sumo.planning.motion_prediction import HORIZON_S, STRIDE, TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import MARGINS, MOTION, PLANNER, PlannerParameters, SafetyMargin
from mdrive_sumo.planning.path_overlap import find_cells
from mdrive_sumo.planning.planning_scale import PlanningScale, find_planning_scale
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.reference_path import (
    PathState,
    ReferencePath,
    RouteSpeeds,
    build_path,
    compute_legal_speeds,
)
from mdrive_sumo.planning.speed_profile import (
    SpeedProfile,
    SpeedProfileProblem,
    build_braking_profile,
    build_free_road_problem,
    compute_station,
)
from mdrive_sumo.planning.stop_lines import StopPoint


class SpaceTimePlanner:
    """The own path, and the speed profile along it."""

    def __init__(
        self, briefing: Briefing, start_yaw: float, cruise_speed: float, parameters: PlannerParameters = PLANNER
    ) -> None:
        self._briefing, self._cruise_speed, self._parameters = briefing, cruise_speed, parameters
        self.scale: PlanningScale = find_planning_scale(briefing, cruise_speed)
        """What follows from the speeds of this route."""
        rear_to_centre = briefing.vehicle.rear_to_centre
        self.path: ReferencePath = build_path(briefing.route_xy, rear_to_centre, start_yaw, self.scale.path)
        self._speeds = self._compute_speeds()
        self._rounded_limits = round_limits(self._speeds.limits, self.scale.lattice)
        self._plan_times: Float = np.arange(1.0, parameters.plan_points + 1) * parameters.interval_s
        """(`plan_points`,) [s] from now."""
        self._profile: SpeedProfile | None = None
        self._profile_tick = self._moved_tick = 0
        self.s = 0.0
        self.reason = Reason(Cause.FREE)
        """What limits the present profile."""

    def _compute_speeds(self) -> RouteSpeeds:
        """Return the legal and comfortable speeds along the path."""
        lateral, braking = self._parameters.lateral_acceleration, self._parameters.braking
        legal = compute_legal_speeds(self.path, self._briefing)
        return RouteSpeeds.compute(self.path, self._cruise_speed, lateral, braking, legal)

    def replace_path(self, path: ReferencePath) -> None:
        """Continue along another path, which begins as the present one does."""
        x, y = self.path.get_points(np.array((self.s,)))[0].tolist()
        self.path, self.s = path, path.project(x, y, self.s)
        self._speeds, self._profile = self._compute_speeds(), None
        self._rounded_limits = round_limits(self._speeds.limits, self.scale.lattice)

    def track_ego(self, tick: int, own: OwnState) -> None:
        """Update the station from the measured state."""
        self.s = self.path.project(own.x, own.y, self.s)
        if abs(own.speed) > MOTION.standing_speed:
            self._moved_tick = tick

    def is_update_due(self, tick: int) -> bool:
        """Return whether `update` must be called in this tick."""
        age, parameters = tick - self._profile_tick, self._parameters
        due = age % self.scale.replan_ticks == 0 or age % parameters.check_ticks == 0
        return self._profile is None or due or not self._is_on_course(tick)

    def update(
        self,
        tick: int,
        speed: float,
        motions: Sequence[PredictedMotion],
        stop_points: Sequence[StopPoint] = (),
    ) -> None:
        """Make a new profile if it is due, or if the present one has become unsafe; speed: measured [m/s]."""
        profile, replan_ticks = self._profile, self.scale.replan_ticks
        conflicts = MotionConflicts(self.path, self._briefing.vehicle, motions)
        if profile is None or not self._is_on_course(tick):
            start = PathState(self.s, speed)
        elif (tick - self._profile_tick) % replan_ticks == 0:
            layer = min((tick - self._profile_tick) // replan_ticks, len(profile.s) - 1)
            start = PathState(float(profile.s[layer]), float(profile.speed[layer]))
            in_queue = any(motion.min_gap_m for motion in motions)
            if in_queue and not start.speed and abs(speed) <= self._parameters.stopped_speed:
                start = PathState(self.s, 0.0)  # its estimated position drifts: a standing car must not follow that
        elif self._is_unsafe(tick, conflicts):
            start = PathState(self.s, speed)
        else:
            return
        profile = self._find_profile(tick, start, conflicts, stop_points)
        self._profile = profile or build_braking_profile(self._build_problem(tick, start))
        self._profile_tick = tick
        self.reason = self._find_reason(start, conflicts, stop_points)
        if profile is None:
            self.reason = replace(self.reason, cause=Cause.NO_WAY)

    def _is_on_course(self, tick: int) -> bool:
        """Return whether the car is where its profile has it."""
        assert self._profile is not None, "is_update_due() asks only for a profile that there is"
        station = compute_station(self._profile, (tick - self._profile_tick) * self._briefing.tick_s)
        return abs(station - self.s) <= self.scale.max_tracking_error_m(float(self._profile.speed[0]))

    def _get_stations(self, tick: int, after: Float) -> Float:
        """Return the stations (K,) [m] of the profile at times (K,) [s] from now."""
        assert self._profile is not None, "update() makes a profile before it is used"
        return self._profile.get_stations((tick - self._profile_tick) * self._briefing.tick_s + after)

    def _is_unsafe(self, tick: int, conflicts: MotionConflicts) -> bool:
        """Return whether the profile meets a motion within `check_s`; a margin violated from the start was intended."""
        count = min(int(self.scale.check_s / TIMES[0]), len(TIMES))
        cells = find_cells(self.path, self._get_stations(tick, TIMES[:count]))
        met = conflicts.find_met(cells, MARGINS.check)
        return bool((met & ~np.logical_and.accumulate(met)).any())

    def _find_profile(
        self,
        tick: int,
        start: PathState,
        conflicts: MotionConflicts,
        stop_points: Sequence[StopPoint],
    ) -> SpeedProfile | None:
        """Return the fastest profile from `start`; None if all collide."""
        problem, parameters = self._build_problem(tick, start), self._parameters
        if tick - self._moved_tick > parameters.deadlock_ticks:
            blocked = self._find_blocked(problem, conflicts, stop_points, parameters.deadlock_margin)
            return find_fastest_profile(replace(problem, blocked=blocked))
        if not self.scale.is_protocol:
            problem = replace(problem, blocked_after=self._find_blocked_after(problem, conflicts, stop_points))
        problem = problem.add_traffic(
            lambda margin: self._find_blocked(problem, conflicts, stop_points, margin),
            parameters.min_margin,
            self.scale.plan_margin,
        )
        return find_fastest_profile(problem)

    def _build_problem(self, tick: int, start: PathState) -> SpeedProfileProblem:
        """Return the problem of driving on a free road for the horizon."""
        now_s = tick / TICKS_PER_SECOND
        until_s = now_s + HORIZON_S + 1e-6
        problem = build_free_road_problem(
            self.path, self._speeds.limits, start, now_s, until_s, self.scale.lattice, HORIZON_S
        )
        return replace(
            problem,
            wait_penalty=self._parameters.wait_penalty,
            must_move=np.zeros_like(problem.must_move),  # a car that must wait waits as long as it takes
        )

    def _find_blocked(
        self,
        problem: SpeedProfileProblem,
        conflicts: MotionConflicts,
        stop_points: Sequence[StopPoint],
        margin: SafetyMargin,
    ) -> Bool:
        """Return `SpeedProfileProblem.blocked` with the motions and the stop points."""
        stride = STRIDE if self.scale.is_protocol else 1
        blocked = conflicts.find_blocked(problem.cells, margin, stride)
        for stop in stop_points:
            blocked[problem.times <= stop.until_s, _find_stop_cell(problem, stop) :] = True
        return blocked

    def _find_blocked_after(
        self, problem: SpeedProfileProblem, conflicts: MotionConflicts, stop_points: Sequence[StopPoint]
    ) -> Bool:
        """Return `SpeedProfileProblem.blocked_after`: of motions that end standing, and of lasting stop points."""
        blocked = conflicts.find_blocked_after(problem.cells, MARGINS.contact)
        for stop in stop_points:
            if stop.until_s > HORIZON_S:
                blocked[_find_stop_cell(problem, stop) :] = True
        return blocked

    def _find_reason(self, start: PathState, conflicts: MotionConflicts, stop_points: Sequence[StopPoint]) -> Reason:
        """Return why the new profile does not drive as on a free road: the first thing that such a drive would meet."""
        assert self._profile is not None, "update() has just made it"
        free = predict_free_stations(self._rounded_limits, self.scale.lattice, start, TIMES)
        if not falls_behind(self._profile, 0.0, free, TIMES):
            return self._speeds.find_reason(start.s)
        first, reason = len(TIMES), self.reason
        for stop in stop_points:
            passed = np.flatnonzero((free > stop.s) & (stop.until_s >= TIMES))
            if len(passed) and passed[0] < first:
                first, reason = int(passed[0]), stop.reason
        met = conflicts.find_first_met(find_cells(self.path, free[:first]), self.scale.plan_margin)
        if met is not None:
            first, reason = met[0], met[1].reason
        if first == len(TIMES) or reason.distance_m is not None:
            return reason
        return replace(reason, distance_m=float(free[first]) - start.s, seconds=reason.seconds or float(TIMES[first]))

    def predict_desired_points(self, speed: float, points: int) -> Float:
        """Return where the car would be every `interval_s` on a free road (points, 2) [m], from that speed [m/s] on."""
        braking, interval_s = self._parameters.braking, self._parameters.interval_s
        stations = drive_freely(self._speeds.limits, self.s, speed, braking, 2 * braking, interval_s, points)
        return self.path.get_points(stations)

    def build_plan(self, tick: int) -> Plan:
        """Return the profile from now on as a plan."""
        return build_frozen(Plan, self.get_planned_points(tick), self._parameters.interval_s, OUR_CONTROLLER)

    def get_planned_points(self, tick: int) -> Float:
        """Return the planned positions (`plan_points`, 2) [m] every `interval_s`."""
        return self.path.get_points(self._get_stations(tick, self._plan_times))


def _find_stop_cell(problem: SpeedProfileProblem, stop: StopPoint) -> int:
    """Return the first cell beyond a stop point."""
    return max(math.ceil((stop.s - problem.lattice_s) / problem.lattice.cell_m), 1)
