"""The paper's rule-based planner for detections: full speed along the route, brakes before hazards (protocol 11.2)."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Note, Objects, Observation, OwnState, Plan, Reason, ReasonLog
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.planning.reference_path import ReferencePath, build_path
from mdrive_sumo.planning.stop_lines import StopLines, build_stop_lines


@dataclass(frozen=True, slots=True)
class HazardRuleParameters:
    """Parameters of `HazardRulePlanner`; the hazard rule is that of protocol 11.2 (CARLA's BasicAgent)."""

    speed: float = 6.0
    """[m/s] 21.6 km/h (paper, table of controllers)."""
    controller: str = "carla-pid-6"
    """CARLA's PID with the gains of the paper for 6 m/s."""
    min_ahead_m: float = 0.5
    """A detection between this distance and `hazard_base_m` plus the way of `hazard_growth_s` ahead is a hazard."""
    hazard_base_m: float = 6.0
    """[m] Range of a hazard at standstill (protocol 11.2)."""
    hazard_growth_s: float = 1.0
    """[s] The range grows by the way that the car drives in this time (protocol 11.2)."""
    max_lateral_m: float = 1.6 + 0.9
    """... unless it is further to the side."""
    hold_ticks: int = 3
    """A hazard counts for this long."""
    standing_speed: float = 0.3
    """[m/s] A slower car ignores hazards from `standing_range_m` on."""
    standing_range_m: float = 4.0
    """[m] See `standing_speed`."""
    interval_s: float = 0.2
    """Spacing of plan points [s]."""
    plan_points: int = 15
    """3 s with `interval_s`."""
    halt_s: float = 1.0
    """A halting plan stands for the second that the controller looks ahead."""


HAZARD_RULE = HazardRuleParameters()


class HazardRulePlanner:
    """CARLA BasicAgent's hazard rule for one car: full speed, or brakes while a detection is close ahead."""

    def __init__(self, briefing: Briefing) -> None:
        """Prepare; the path needs the first observation, which has the heading of the car."""
        self._briefing = briefing
        self._route: tuple[ReferencePath, StopLines] | None = None
        self._s, self._hold_until_tick = 0.0, 0
        self._reasons, self._hazard = ReasonLog(), Reason(Cause.HAZARD)

    def plan(self, seen: Observation, objects: Objects) -> tuple[Plan, tuple[Note, ...]]:
        """Return a plan that drives along the route at full speed, or stands; and notes of why.

        objects: all that are known at the tick of the observation, in the world frame.
        """
        path, lights = self._route = self._route or self._build_route(seen.own)
        self._s = path.project(seen.own.x, seen.own.y, self._s)
        hazards = find_hazards(seen.own, objects)
        if hazards.any():
            self._hold_until_tick = seen.tick + HAZARD_RULE.hold_ticks
            self._hazard = _describe_hazard(seen.own, objects.take(hazards))
        reason = self._hazard if seen.tick < self._hold_until_tick else self._find_red_light(lights, seen)
        plan = self._build_plan(path, halts=reason is not None)
        return plan, self._reasons.record(reason or Reason(Cause.FREE, speed=HAZARD_RULE.speed))

    def _build_route(self, own: OwnState) -> tuple[ReferencePath, StopLines]:
        """Return the path, and the traffic lights on it: BasicAgent obeys no stop signs."""
        path = build_path(self._briefing.route_xy, self._briefing.vehicle.rear_to_centre, own.yaw)
        return path, build_stop_lines(path, self._briefing, include_signs=False)

    def _find_red_light(self, lights: StopLines, seen: Observation) -> Reason | None:
        """Return the closed light within the range of a hazard as a reason, None if there is none."""
        ahead = lights.find_stops(self._s, seen.own.speed, seen.signals, lambda line: line > self._s)
        range_m = compute_hazard_range(seen.own.speed)
        return next((stop.reason for stop in ahead if stop.s - self._s < range_m), None)

    def _build_plan(self, path: ReferencePath, halts: bool) -> Plan:
        """Return full speed along the path; a halting plan stands for `halt_s` first."""
        parameters = HAZARD_RULE
        after = np.arange(1, parameters.plan_points + 1, dtype=np.float64) * parameters.interval_s
        moving_s = np.maximum(after - parameters.halt_s, 0.0) if halts else after
        stations = self._s + parameters.speed * moving_s
        return Plan(path.get_points(stations), parameters.interval_s, parameters.controller)


def compute_hazard_range(speed: float) -> float:
    """Return how far ahead [m] of the box centre a detection is a hazard, at that speed [m/s]."""
    return HAZARD_RULE.hazard_base_m + max(speed, 0.0) * HAZARD_RULE.hazard_growth_s


def find_hazards(own: OwnState, objects: Objects) -> Bool:
    """Return a mask (N,): detections whose centre is in the lane-wide box straight ahead (protocol 11.2)."""
    parameters = HAZARD_RULE
    dx, dy = objects.x - own.x, objects.y - own.y
    cos, sin = portable.cos_sin(own.yaw)
    ahead, lateral = cos * dx + sin * dy, cos * dy - sin * dx
    close = (ahead >= parameters.min_ahead_m) & (ahead <= compute_hazard_range(own.speed))
    close &= np.abs(lateral) <= parameters.max_lateral_m
    if abs(own.speed) < parameters.standing_speed:
        close &= ahead < parameters.standing_range_m
    return close


def _describe_hazard(own: OwnState, hazards: Objects) -> Reason:
    """Return the nearest hazard as a reason."""
    distances_m = portable.hypot(hazards.x - own.x, hazards.y - own.y)
    row = int(distances_m.argmin())
    position = float(hazards.x[row]), float(hazards.y[row])
    return Reason(Cause.HAZARD, (hazards.ids[row],), position, float(distances_m[row]))
