"""`idm`: the Intelligent Driver Model with right of way by observation."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mdrive_sumo.contract import Briefing, Cause, Objects, Observation, Reason, ReasonLog, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.driving_options import MAX_SPEED, ROAD_RANGE_M
from mdrive_sumo.planning.obstacle_avoidance import ObstacleAvoidance
from mdrive_sumo.planning.parameters import MOTION
from mdrive_sumo.planning.path_follower import PathFollower
from mdrive_sumo.planning.planning_scale import find_cruise_speed, find_planning_scale
from mdrive_sumo.planning.reference_path import RouteSpeeds, build_path, compute_legal_speeds
from mdrive_sumo.planning.stop_lines import StopLines, StopPoint, build_stop_lines

OPTIONS = {
    "speed": Option(PROTOCOL_SPEED, 1.0, MAX_SPEED),
    "time_gap": Option(1.0, 0.2, 5.0),
    "range": Option(60.0, 5.0, ROAD_RANGE_M),
}


@dataclass(frozen=True, slots=True)
class IdmParameters:
    """Parameters of `IdmAgent`. All values are design choices; those of the IDM are in the range of its paper."""

    acceleration: float = 2.0
    """[m/s2]"""
    braking: float = 2.5
    """[m/s2] Comfortable."""
    hard_braking: float = 6.0
    """[m/s2]"""
    stop_braking: float = 2.0
    """[m/s2] Towards a stop line."""
    response_s: float = 0.5
    """Time constant with which it approaches the speed from which it could just stop comfortably."""
    standing_gap_m: float = 2.0
    """Gap to the car ahead when both stand: the IDM's s0, 2 m in its paper."""
    lateral_acceleration: float = 2.5
    """[m/s2]"""
    decision_ticks: int = 4
    """It decides at 5 Hz, as the paper's planners do, and holds its acceleration in between."""
    noticeable_braking: float = 0.5
    """[m/s2] A constraint that takes less off the acceleration on a free road is not named as the reason."""
    crossing_gap_m: float = 2.0
    """Distance between the waiting position and the shared area."""


class _Demand(NamedTuple):
    """The acceleration [m/s2] that a constraint demands."""

    acceleration: float
    reason: Reason


class IdmAgent:
    """Drives alone and by sight: keeps distance (IDM), yields by time-to-conflict, drives around what stands.

    Intelligent Driver Model: Treiber, Hennecke, Helbing, Congested traffic states in empirical observations and
    microscopic simulations, Phys. Rev. E 62 (2000) 1805. It knows no intentions: a vehicle that will turn is predicted
    to go straight on until it turns. Around parked vehicles and static objects it takes the detours of the other
    baselines (`ObstacleAvoidance`), where the road has room and nothing comes towards it.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        options = read_options("idm", config, OPTIONS)
        self._chosen_speed = options["speed"] if "speed" in config else None
        self._time_gap, self._range = options["time_gap"], options["range"]
        self._road_range = self._range if "range" in config else ROAD_RANGE_M
        self._parameters = IdmParameters()

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of nearby boxes."""
        return (SensorSpec("objects", range_m=self._range, options={"road_range_m": self._road_range}),)

    def start(self, briefing: Briefing) -> None:
        """Build the path and its speed limits."""
        self._briefing = briefing
        self._cruise_speed = find_cruise_speed(briefing, self._chosen_speed, PROTOCOL_SPEED)
        self._scale = find_planning_scale(briefing, self._cruise_speed)
        self._follower = PathFollower(
            build_path(briefing.route_xy, briefing.vehicle.rear_to_centre, parameters=self._scale.path)
        )
        self._speeds = self._compute_speeds()
        self._stop_lines = StopLines([sign.s for sign in briefing.stop_signs], briefing.traffic_lights)
        self._avoidance = ObstacleAvoidance(briefing, self._scale)
        self._acceleration, self._tick, self._decision_tick = 0.0, -1, -self._parameters.decision_ticks
        self._curvatures = right_of_way.CurvatureEstimator()
        self._yielding = right_of_way.YieldingPolicy(briefing.seed)
        self._reasons, self._reason = ReasonLog(), Reason(Cause.FREE)

    def _compute_speeds(self) -> RouteSpeeds:
        """Return the legal and comfortable speeds along the path."""
        path, parameters = self._follower.path, self._parameters
        lateral, braking = parameters.lateral_acceleration, parameters.braking
        legal = compute_legal_speeds(path, self._briefing)
        return RouteSpeeds.compute(path, self._cruise_speed, lateral, braking, legal)

    def act(self, seen: Observation) -> Reply:
        """Return the plan that follows from the last decision."""
        if self._tick < 0 and self._briefing.desired_speed is None:
            self._follower.start_at(seen.own.speed)
        self._follower.update(seen.own.x, seen.own.y, seen.own.speed)
        undecided_ticks = seen.tick - self._decision_tick
        if undecided_ticks >= self._parameters.decision_ticks:
            self._acceleration, self._reason = self._decide(seen, undecided_ticks * self._briefing.tick_s)
            self._decision_tick = seen.tick
        elapsed_s = (seen.tick - self._tick) * self._briefing.tick_s  # several ticks if replies are late
        self._tick = seen.tick
        plan = self._follower.advance(self._acceleration, self._speeds.limits, elapsed_s)
        return build_frozen(Reply, None, plan, (), self._reasons.record(self._reason), None)

    def _decide(self, seen: Observation, elapsed_s: float) -> _Demand:
        """Return the lowest acceleration that any constraint demands; elapsed_s: since the last one."""
        objects, stops = self._avoid_obstacles(seen)
        parameters, position = self._parameters, (seen.own.x, seen.own.y)
        ego = right_of_way.EgoMotion(position, self._follower.speed, self._cruise_speed, parameters.acceleration)
        path, ahead = self._follower.path, self._scale.right_of_way
        preview = right_of_way.preview_path(path, self._follower.s, self._briefing.vehicle, ahead)
        curvature = self._curvatures.update(objects, elapsed_s)
        conflicts = right_of_way.find_crossing_conflicts(preview, objects, curvature, ahead)
        free = self._accelerate_freely()
        demands = [self._yield_to_conflicts(ego, conflicts, elapsed_s)]
        demands += [self._follow(lead) for lead in right_of_way.find_lead_objects(ego, preview, objects)]
        demands += [_Demand(self._stop_within(stop.s - self._follower.s), stop.reason) for stop in stops]
        lowest = min(demands, key=lambda demand: demand.acceleration)
        # The IDM brakes a little for the most distant car ahead: that is no reason worth telling.
        limited = lowest.acceleration < free - parameters.noticeable_braking
        reason = lowest.reason if limited else self._speeds.find_reason(self._follower.s)
        return _Demand(max(min(free, lowest.acceleration), -parameters.hard_braking), reason)

    def _avoid_obstacles(self, seen: Observation) -> tuple[Objects, list[StopPoint]]:
        """Return the objects, and where to stop; take a detour where one is free."""
        assert seen.objects is not None, "the objects sensor is declared"
        follower, path = self._follower, self._follower.path
        line_stops = self._find_line_stops(seen)
        objects, waits = self._avoidance.update(seen, seen.objects, follower, [stop.s for stop in line_stops])
        if follower.path is not path:
            self._speeds = self._compute_speeds()
            self._stop_lines = build_stop_lines(follower.path, self._briefing)
            line_stops = self._find_line_stops(seen)
        return objects, [*line_stops, *waits]

    def _accelerate_freely(self) -> float:
        """Return the IDM's acceleration [m/s2] on a free road."""
        square = portable.square(self._follower.speed / self._cruise_speed)
        return self._parameters.acceleration * (1 - square * square)

    def _follow(self, lead: right_of_way.LeadObject) -> _Demand:
        """Return the IDM's acceleration behind a leading object."""
        speed, acceleration = self._follower.speed, self._parameters.acceleration
        closing = speed * (speed - lead.speed) / (2 * math.sqrt(acceleration * self._parameters.braking))
        desired_m = self._parameters.standing_gap_m + max(0.0, speed * self._time_gap + closing)
        cause = Cause.FOLLOW if lead.speed > MOTION.standing_speed else Cause.BLOCKED
        reason = Reason(cause, (lead.id,), lead.position, lead.gap_m)
        demanded = self._accelerate_freely() - acceleration * portable.square(desired_m / max(lead.gap_m, 0.1))
        return _Demand(demanded, reason)

    def _stop_within(self, gap: float) -> float:
        """Return the acceleration [m/s2] that stops within `gap` [m], as hard as needed once braking is due."""
        speed = self._follower.speed
        if gap < 0.1:
            return -self._parameters.hard_braking
        allowed = math.sqrt(2 * self._parameters.stop_braking * gap)
        return -(speed * speed) / (2 * gap) if speed > allowed else (allowed - speed) / self._parameters.response_s

    def _find_line_stops(self, seen: Observation) -> list[StopPoint]:
        """Return where signs and lights stop the box centre."""
        s = self._follower.s

        def can_stop(line: float) -> bool:
            return line > s and self._can_stop_within(line - s)

        return self._stop_lines.find_stops(self._follower.actual_s, seen.own.speed, seen.signals, can_stop)

    def _can_stop_within(self, gap: float) -> bool:
        """Return whether hard braking stops within `gap` [m]."""
        return (self._follower.speed * self._follower.speed) / (2 * max(gap, 0.5)) < self._parameters.hard_braking

    def _yield_to_conflicts(
        self, ego: right_of_way.EgoMotion, conflicts: list[right_of_way.CrossingConflict], elapsed_s: float
    ) -> _Demand:
        """Return the acceleration that waits before the first conflict if any road user goes first."""
        gap_m = self._parameters.crossing_gap_m
        avoidable = [c for c in conflicts if c.begin_m > 0 and self._can_stop_within(c.begin_m - gap_m)]
        first_ids = self._yielding.select_first(ego, avoidable, elapsed_s)
        first = min((c for c in avoidable if c.id in first_ids), key=lambda c: c.begin_m, default=None)
        if first is None:
            return _Demand(math.inf, self._reason)
        wait_m = min(conflict.begin_m for conflict in avoidable) - gap_m
        arrives_s = None if first.is_standing else first.arrives_s
        return _Demand(self._stop_within(wait_m), Reason(Cause.YIELD, (first.id,), first.position, wait_m, arrives_s))
