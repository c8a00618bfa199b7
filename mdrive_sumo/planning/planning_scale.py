"""What follows from the speeds that a car plans with: how finely it plans, and how far it looks ahead."""

from dataclasses import dataclass, replace
from functools import cached_property

from mdrive_sumo.contract import Briefing
from mdrive_sumo.planning.parameters import (
    AVOIDANCE,
    DETOUR,
    MARGINS,
    MOTION,
    PLANNER,
    RIGHT_OF_WAY,
    AvoidanceParameters,
    DetourParameters,
    RightOfWayParameters,
    SafetyMargin,
)
from mdrive_sumo.planning.reference_path import PATH, PathParameters
from mdrive_sumo.planning.speed_lattice import FINE, SpeedLattice, choose_lattice

RUN_OUT_S = 3.0
"""[s] Paths continue beyond the goal for this time: trackers look at so much of a plan."""
REFERENCE_SPEED = 8.0
"""[m/s] The distances in `planning.parameters` are for this speed."""
TRACKING_ERROR_S = 0.05
"""[s] A faster car may be this much time away from its profile: 1.6 m at 33 m/s. Measured on a motorway bend with a
perfect own state: at most 0.3 m while it keeps its speed, 1.2 m where the engine cannot follow an acceleration."""


@dataclass(frozen=True)
class PlanningScale:
    """Lattice, distances and tolerances for one top speed; those of the protocol up to `FINE.top_speed`."""

    top_speed: float
    """[m/s]"""

    @cached_property
    def lattice(self) -> SpeedLattice:
        """The lattice of speed profiles."""
        return choose_lattice(self.top_speed)

    @property
    def factor(self) -> float:
        """Factor on distances ahead: a faster car sees as many seconds ahead. 1 for the speeds of the protocol."""
        return 1.0 if self.top_speed <= FINE.top_speed else self.top_speed / REFERENCE_SPEED

    @property
    def is_protocol(self) -> bool:
        """Whether the top speed is one of the protocol."""
        return self.factor == 1.0

    @cached_property
    def right_of_way(self) -> RightOfWayParameters:
        """Parameters of right of way: the same number of stations, further apart."""
        factor = self.factor
        ahead_m, stride_m = RIGHT_OF_WAY.look_ahead_m * factor, RIGHT_OF_WAY.stride_m * factor
        return replace(RIGHT_OF_WAY, look_ahead_m=ahead_m, stride_m=stride_m)

    @cached_property
    def detour(self) -> DetourParameters:
        """Parameters of detours."""
        return replace(DETOUR, look_ahead_m=DETOUR.look_ahead_m * self.factor)

    @cached_property
    def avoidance(self) -> AvoidanceParameters:
        """Parameters of obstacle avoidance: the same number of stations, further apart."""
        factor, known = self.factor, AVOIDANCE
        return replace(
            known,
            stride_m=known.stride_m * factor,
            straight_on_m=known.straight_on_m * factor,
            straight_on_step_m=known.straight_on_step_m * factor,
        )

    @property
    def others_top_speed(self) -> float:
        """Speed [m/s] up to which other vehicles are expected to accelerate: the own limits hold for them too."""
        return MOTION.top_speed if self.is_protocol else self.top_speed

    @property
    def path(self) -> PathParameters:
        """Parameters of paths: a plan must not end before the goal is passed."""
        return PATH if self.is_protocol else replace(PATH, run_out_m=max(PATH.run_out_m, RUN_OUT_S * self.top_speed))

    @property
    def replan_ticks(self) -> int:
        """Ticks between two profiles: one step of the lattice."""
        return round(self.lattice.step_s / FINE.step_s * PLANNER.replan_ticks)

    @property
    def plan_margin(self) -> SafetyMargin:
        """Margin for planning: a faster car errs more along its path."""
        least = MARGINS.plan
        if self.is_protocol:
            return least
        return SafetyMargin(least.longitudinal + TRACKING_ERROR_S * self.top_speed, least.lateral)

    @property
    def check_s(self) -> float:
        """Time [s] for which the present profile is checked: until a car with braking 4 m/s2 stands, and a second."""
        return PLANNER.check_s if self.is_protocol else max(PLANNER.check_s, self.top_speed / 4 + 1.0)

    def max_tracking_error_m(self, speed: float) -> float:
        """Return the tolerated distance [m] between a car of that speed [m/s] and its profile."""
        least = PLANNER.max_tracking_error_m
        return least if self.is_protocol else max(least, TRACKING_ERROR_S * speed)


PROTOCOL_SCALE = PlanningScale(REFERENCE_SPEED)


def find_cruise_speed(briefing: Briefing, chosen: float | None, default: float) -> float:
    """Return the speed [m/s] that a car drives where road and traffic allow it.

    chosen: by an option, which overrides all; default: where the scenario has the speed of the protocol. On roads
    whose limits count it is the highest of the route.
    """
    if chosen is not None:
        return chosen
    return default if briefing.desired_speed is not None else float(briefing.route_speed_limit.max())


def find_planning_scale(briefing: Briefing, cruise_speed: float) -> PlanningScale:
    """Return the scale of planning on a route for a car with that cruising speed [m/s]."""
    if cruise_speed <= FINE.top_speed:
        return PlanningScale(cruise_speed)
    return PlanningScale(min(cruise_speed, max(float(briefing.route_speed_limit.max()), 1.0)))
