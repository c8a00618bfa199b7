"""`omniscient`: the upper bound."""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mdrive_sumo.contract import (
    MAX_PLAN_POINTS,
    Briefing,
    Cause,
    Observation,
    OwnState,
    Plan,
    Privileged,
    Reason,
    ReasonLog,
    Reply,
    SensorSpec,
)
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.driving_options import MAX_SPEED
from mdrive_sumo.planning.fleet_paths import FleetPaths, find_cells_blocked_by_objects, predict_stations
from mdrive_sumo.planning.free_drive import (
    falls_behind,
    find_first_met,
    find_waiting_pedestrian,
    predict_free_stations,
    round_limits,
)
from mdrive_sumo.planning.joint_plan import (
    find_common_scale,
    find_road_horizon,
    has_undecided_vehicle,
    plan_joint_detours,
    plan_on_roads,
)
from mdrive_sumo.planning.motion_prediction import TIMES
from mdrive_sumo.planning.parameters import MARGINS, PLANNER, SafetyMargin
from mdrive_sumo.planning.path_overlap import find_cells
from mdrive_sumo.planning.pedestrian_caution import limit_speeds_near_pedestrians, predict_walking_on
from mdrive_sumo.planning.planning_order import find_planning_order
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.reference_path import (
    SPACING_M,
    PathState,
    ReferencePath,
    RouteSpeeds,
    build_path,
    compute_curve_speeds,
    compute_legal_speeds,
    convert_route_station,
)
from mdrive_sumo.planning.road_conflicts import RoadConflicts, RoadSituation, find_red_light
from mdrive_sumo.planning.road_direction import build_road_direction
from mdrive_sumo.planning.speed_lattice import SAMPLE_S
from mdrive_sumo.planning.speed_profile import (
    SpeedProfile,
    SpeedProfileProblem,
    build_braking_profile,
    build_free_road_problem,
)
from mdrive_sumo.planning.stop_lines import build_stop_lines

OPTIONS = {"speed": Option(9.0, 2.0, MAX_SPEED)}
FIRST_PLAN_POINTS = 20
"""Points of the plan of a car that starts at speed, until it has a profile: 5 s."""


@dataclass(frozen=True, slots=True)
class OmniscientParameters:
    """Parameters of `OmniscientAgent`. All values are design choices of this agent."""

    lateral_acceleration: float = 3.0
    """[m/s2]"""
    braking: float = 2.0
    """[m/s2]"""
    time_reserve_s: float = 1.0
    """Profiles end this long before the time limit."""
    min_horizon_s: float = 10.0
    """[s] A profile is planned for at least so long, even close to the time limit."""
    interval_s: float = 0.25
    """Spacing of plan points."""
    beyond_goal_m: float = 6.0
    """A published plan continues this far beyond the goal."""
    review_ticks: int = 10
    """Every CAV reviews its plan this often, each in its own tick, so that no two change their plans at once."""
    review_s: float = 8.0
    """[s] How far ahead the present profile is checked."""
    stop_before_m: tuple[float, float] = (2.5, 1.0)
    """The box centre stops at most and at least this far before the line of a stop sign."""
    stop_tolerance_m: float = 1.0
    """A stop this much earlier still obeys the sign."""
    stopped_speed: float = 0.05
    """[m/s]"""
    stop_layers: int = 3
    """Duration of the stop in steps of a profile."""
    decision_ticks: int = 10
    """A vehicle in the way that has not left by then is parked."""


class OmniscientAgent:
    """Knows every state and every plan, and times its way through the gaps: the upper bound.

    Prioritised planning: at the first tick (or `decision_ticks` later, if a vehicle in the way may be about to leave)
    all CAVs compute the same detours and the same order. Number r plans r ticks later around the plans that it sees
    then, keeps its plan, and makes a new one only when that has become unsafe or the car has left it.
    """

    label = "privileged"

    def __init__(self, config: Config) -> None:
        speed = read_options("omniscient", config, OPTIONS)["speed"]
        self._chosen_speed = speed if "speed" in config else None
        self._parameters = OmniscientParameters()

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the privileged sensor."""
        return (SensorSpec("privileged"),)

    def start(self, briefing: Briefing) -> None:
        """Store the briefing; everything else needs the first observation."""
        self._briefing = briefing
        self._road: RoadConflicts | None = None
        """What else is on the road, where its limits count."""
        self._profile: SpeedProfile | None = None
        self._profile_tick = 0
        self._s = 0.0
        self._begin_tick: int | None = None
        self._review_tick: int | None = None
        self._reasons, self._reason = ReasonLog(), Reason(Cause.FREE)

    def act(self, seen: Observation) -> Reply:
        """Return the plan, made or reviewed when it is this CAV's turn."""
        assert seen.privileged is not None, "the privileged sensor is declared"
        if self._begin_tick is None:
            self._begin_tick = self._choose_begin_tick(seen.tick, seen.privileged)
        objects = predict_walking_on(seen.privileged.objects, self._first_positions)
        known = replace(seen.privileged, objects=objects)
        if self._road is not None:
            self._road.trends.update(objects, seen.tick * self._briefing.tick_s)
        if seen.tick < self._begin_tick:
            return Reply(plan=self._build_plan(seen))
        if self._review_tick is None:
            self._plan_jointly(known)
            self._review_tick = self._begin_tick + self._rank
        self._s = self._path.project(seen.own.x, seen.own.y, self._s)
        self._red_s = find_red_light(self._lights, self._s, seen)
        self._signs = [line for line in self._signs if not self._is_sign_obeyed(line, seen.own.speed)]
        if seen.tick >= self._review_tick:
            self._review_tick = self._find_next_review(self._review_tick, seen.tick)
            if not self._is_plan_valid(seen, known):
                self._profile, self._profile_tick = self._find_profile(seen, known), seen.tick
            self._reason = self._find_reason(seen, known)
        return Reply(plan=self._build_plan(seen), notes=self._reasons.record(self._reason))

    def _find_reason(self, seen: Observation, known: Privileged) -> Reason:
        """Return why the profile is slower than a drive on a free road: the first thing that this would meet."""
        assert self._profile is not None, "a review makes a profile first"
        start, lattice = PathState(self._s, max(seen.own.speed, 0.0)), self._scale.lattice
        free = predict_free_stations(round_limits(self._speeds, lattice), lattice, start, TIMES)
        age_s = (seen.tick - self._profile_tick) * self._briefing.tick_s
        if not falls_behind(self._profile, age_s, free, TIMES):
            return RouteSpeeds(self._speeds, self._scale.top_speed, self._legal).find_reason(self._s)
        lines = [(line, Cause.STOP_SIGN) for line in self._signs]
        line_s, cause = min([*lines, (self._red_s, Cause.LIGHT)])
        before_line = free[free <= line_s]
        met = find_first_met(known, self._briefing.ego_id, self._path, before_line)
        if met is None and math.isfinite(line_s) and len(before_line) < len(free):
            return Reason(cause, distance_m=max(line_s - self._s, 0.0))
        return met or find_waiting_pedestrian(known.objects, seen.own) or Reason(Cause.AVOID)

    def _choose_begin_tick(self, tick: int, known: Privileged) -> int:
        """Return the tick from which to plan, at the first observation; remember scale and first positions."""
        objects = known.objects
        positions = zip(objects.x.tolist(), objects.y.tolist(), strict=True)
        self._first_positions = dict(zip(objects.ids, positions, strict=True))
        self._scale = find_common_scale(self._briefing, self._chosen_speed, OPTIONS["speed"].default, known)
        if not self._scale.is_protocol:
            road = build_road_direction(self._briefing)
            self._road = RoadConflicts(self._briefing, road, self._scale.top_speed)
        is_undecided = has_undecided_vehicle(known, self._briefing, self._scale)
        return tick + (self._parameters.decision_ticks if is_undecided else 0)

    def _find_next_review(self, due: int, tick: int) -> int:
        """Return the tick of the next review after the one that was due: observations may come every few ticks only."""
        period = self._parameters.review_ticks
        return due + period * ((tick - due) // period + 1)

    def _plan_jointly(self, known: Privileged) -> None:
        """Find the paths of all CAVs and the order of planning."""
        briefing = self._briefing
        if self._road is not None:
            self._fleet, order = plan_on_roads(known, briefing, self._scale, self._compute_speeds)
        else:
            self._fleet, order = self._plan_for_protocol(known)
        self._path: ReferencePath = self._fleet.path_by_ego[briefing.ego_id]
        self._legal = compute_legal_speeds(self._path, briefing)
        self._speeds = self._compute_speeds(self._path, self._legal)
        self._lights = build_stop_lines(self._path, briefing, include_signs=False)
        self._rank = order.index(briefing.ego_id)
        self._earlier = order[: self._rank]
        self._signs = [convert_route_station(self._path, briefing, sign.s) for sign in briefing.stop_signs]

    def _plan_for_protocol(self, known: Privileged) -> tuple[FleetPaths, tuple[str, ...]]:
        """Return the paths of all CAVs and the order for the speeds of the protocol: all start from a standstill."""
        briefing = self._briefing
        fleet = FleetPaths(plan_joint_detours(known, briefing), (briefing.vehicle.length, briefing.vehicle.width))
        until_s = briefing.time_limit_s - self._parameters.time_reserve_s
        problems = {
            ego: build_free_road_problem(path, self._compute_speeds(path), PathState(0.0, 0.0), 0.0, until_s)
            for ego, path in fleet.path_by_ego.items()
        }
        return fleet, find_planning_order(fleet, problems)

    def _compute_speeds(self, path: ReferencePath, legal: Float | None = None) -> Float:
        """Return the comfortable speed (M,) [m/s] at the points of a path. legal: (M,) limits [m/s] that hold too."""
        lateral, braking = self._parameters.lateral_acceleration, self._parameters.braking
        return compute_curve_speeds(path, self._scale.top_speed, lateral, braking, legal)

    def _is_sign_obeyed(self, line: float, speed: float) -> bool:
        """Return whether the car stands close before the line of a stop sign or has passed it."""
        parameters = self._parameters
        most_m, least_m = parameters.stop_before_m
        close = self._s > line - most_m - parameters.stop_tolerance_m
        return (abs(speed) < parameters.stopped_speed and close) or self._s > line - least_m / 2

    def _is_plan_valid(self, seen: Observation, known: Privileged) -> bool:
        """Return whether the profile reaches the goal, the car is on it, and it is free for `review_s`."""
        profile, parameters = self._profile, self._parameters
        if profile is None or not profile.reaches_goal:
            return False
        age_s = (seen.tick - self._profile_tick) * self._briefing.tick_s
        tolerance_m = self._scale.max_tracking_error_m(seen.own.speed)
        if abs(float(profile.get_stations(np.full(1, age_s))[0]) - self._s) > tolerance_m:
            return False
        if self._road is not None:
            times = np.arange(1, int(parameters.review_s / SAMPLE_S) + 1, dtype=np.float64) * SAMPLE_S
            now = self._describe_situation(seen, known, respects_all=self._is_settled(seen.tick))
            met = self._road.find_met(now, self._fleet, profile.get_stations(age_s + times), times, MARGINS.check)
            return not (met & ~np.logical_and.accumulate(met)).any()
        count = int(parameters.review_s / parameters.interval_s)
        times = np.arange(1, count + 1, dtype=np.float64) * parameters.interval_s
        stations = profile.get_stations(age_s + times)
        blocked = self._find_blocked(known, find_cells(self._path, stations), times, MARGINS.check)
        met = np.diagonal(blocked) | (stations > self._red_s)
        return not (met & ~np.logical_and.accumulate(met)).any()  # a margin violated from the start was intended

    def _find_blocked(self, known: Privileged, cells: Int, times: Float, margin: SafetyMargin) -> Bool:
        """Return a mask (T, J): which cells (J,) other road users block at times (T,) [s] from now.

        CAVs later in the order give way: a leader must not brake for a follower. A new plan in the middle of the
        episode respects them too, because it surprises them.
        """
        briefing = self._briefing
        respects_all = self._profile is not None and margin != MARGINS.check
        size = briefing.vehicle.length, briefing.vehicle.width
        blocked = find_cells_blocked_by_objects(self._path, cells, known.objects, times, size, margin)
        for other, state, plan in zip(known.ego_ids, known.states, known.plans, strict=True):
            if other in self._earlier or (other != briefing.ego_id and respects_all):
                stations = predict_stations(self._fleet.path_by_ego[other], state, plan, times, briefing.tick_s)
                blocked |= self._fleet.find_blocked_cells(briefing.ego_id, cells, other, stations, margin)
        blocked[:, cells * SPACING_M > self._red_s] = True
        return blocked

    def _is_settled(self, tick: int) -> bool:
        """Return whether all CAVs have planned; a conflict with a later one means that it could not avoid it."""
        assert self._begin_tick is not None
        return tick > self._begin_tick + len(self._fleet.path_by_ego) + self._parameters.review_ticks

    def _describe_situation(self, seen: Observation, known: Privileged, respects_all: bool) -> RoadSituation:
        """Return what the own car knows where limits of roads count; respects_all: of all CAVs, else earlier ones."""
        respected = known.ego_ids if respects_all else self._earlier
        return RoadSituation(known, self._s, seen.own.speed, self._red_s, respected)

    def _find_profile(self, seen: Observation, known: Privileged) -> SpeedProfile:
        """Return a new profile from the present state, with the stops that are due."""
        briefing = self._briefing
        now_s = seen.tick * briefing.tick_s
        speeds = limit_speeds_near_pedestrians(self._path, self._speeds, known.objects, briefing.vehicle)
        start, lattice = PathState(self._s, seen.own.speed), self._scale.lattice
        free = build_free_road_problem(self._path, speeds, start, now_s, self._find_horizon(now_s), lattice)
        if self._road is not None:
            return self._find_profile_on_roads(seen, known, free)
        problem = free.add_traffic(partial(self._find_blocked, known, free.cells, free.times))
        done, problem = self._find_profile_with_stops(problem)
        last = find_fastest_profile(problem) or build_braking_profile(problem)
        return last if done is None else done.append(last)

    def _find_profile_with_stops(self, problem: SpeedProfileProblem) -> tuple[SpeedProfile | None, SpeedProfileProblem]:
        """Return the profile until the last stop that is due, None without one, and the problem that remains."""
        done: SpeedProfile | None = None
        most_m, least_m = self._parameters.stop_before_m
        for line in self._signs:
            part = find_fastest_profile(problem.require_stop(line - most_m, line - least_m))
            if part is None or not part.reaches_goal:
                break
            part = part.extend_standstill(self._parameters.stop_layers)
            problem, done = problem.build_remainder(part), part if done is None else done.append(part)
        return done, problem

    def _find_profile_on_roads(self, seen: Observation, known: Privileged, free: SpeedProfileProblem) -> SpeedProfile:
        """Return `_find_profile` where limits of roads count, from the problem on a free road."""
        assert self._road is not None
        road, fleet = self._road, self._fleet
        # It closes up: others may leave a gap earlier than they are predicted to.
        free = replace(free, wait_penalty=PLANNER.wait_penalty)
        first = self._profile is None
        now = self._describe_situation(seen, known, respects_all=not first)
        problem = free.add_traffic(
            partial(road.find_blocked, now, fleet, free.cells, free.times), plan_margin=self._scale.plan_margin
        )
        done, problem = self._find_profile_with_stops(problem)
        last = find_fastest_profile(problem)
        if last is not None or done is not None:
            last = last or build_braking_profile(problem)
            return last if done is None else done.append(last)
        now = self._describe_situation(seen, known, respects_all=True)
        age_s = (seen.tick - self._profile_tick) * self._briefing.tick_s
        return road.find_way_out(now, fleet, self._speeds, None if first else self._profile, age_s)

    def _find_horizon(self, now_s: float) -> float:
        """Return until when a profile may last [s]."""
        parameters = self._parameters
        if self._road is not None:
            return now_s + find_road_horizon(self._speeds, self._s)
        return max(self._briefing.time_limit_s - parameters.time_reserve_s, now_s + parameters.min_horizon_s)

    def _build_plan(self, seen: Observation) -> Plan:
        """Return the plan that others may rely on: the profile until beyond the goal, or standing here."""
        interval_s = self._parameters.interval_s
        if self._profile is None:
            return self._build_first_plan(seen.own)
        age_s = (seen.tick - self._profile_tick) * self._briefing.tick_s
        after = np.arange(1, MAX_PLAN_POINTS + 1, dtype=np.float64) * interval_s
        stations = self._profile.get_stations(age_s + after)
        beyond_m = max(self._parameters.beyond_goal_m, self._scale.path.run_out_m - 4.0)
        count = int(np.searchsorted(stations, self._path.goal_s + beyond_m)) + 1
        return Plan(self._path.get_points(stations[:count]), interval_s)

    def _build_first_plan(self, own: OwnState) -> Plan:
        """Return standing here, or where limits of roads count going on at the present speed."""
        here, interval_s = np.array([(own.x, own.y)]), self._parameters.interval_s
        if self._road is None or own.speed < self._parameters.stopped_speed:
            return Plan(here, interval_s)
        after = np.arange(1, FIRST_PLAN_POINTS + 1, dtype=np.float64) * interval_s
        path = build_path(self._briefing.route_xy, self._briefing.vehicle.rear_to_centre, own.yaw, self._scale.path)
        return Plan(path.get_points(path.project(own.x, own.y, self._s, path.length) + own.speed * after), interval_s)
