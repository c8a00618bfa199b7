"""Parameters of motion planning: one frozen dataclass per module, every field with its unit and its source.

A value without a named source is a design choice of the shared planner (docs/decisions/012). The lattice itself
(`speed_profile`) and the sampling times of predictions (`motion_prediction`) are no parameters: cells, profiles and
predictions have to agree on them.
"""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class SafetyMargin:
    """Free space between two vehicles [m]."""

    longitudinal: float
    lateral: float


@dataclass(frozen=True, slots=True)
class MarginParameters:
    """Margins for the different uses of an overlap test."""

    plan: SafetyMargin = SafetyMargin(0.9, 0.4)
    """For planning: covers tracking errors and the motion between two samples."""
    check: SafetyMargin = SafetyMargin(0.3, 0.15)
    """For checking an existing plan: smaller, so that rounding does not invalidate it."""
    contact: SafetyMargin = SafetyMargin(0.05, 0.1)
    """Where the plan's margin is already violated."""
    standing: SafetyMargin = SafetyMargin(0.5, 0.2)
    """Around standing objects at most: their position needs no prediction."""


@dataclass(frozen=True, slots=True)
class DetourParameters:
    """Limits of a lateral shift of the path around obstacles."""

    look_ahead_m: float = 40.0
    """Obstacles further ahead are left for later."""
    obstructing_gap_m: float = 0.25
    """An obstacle that would be passed with a smaller lateral gap obstructs the path."""
    clearance_m: float = 0.5
    """Lateral gap to passed obstacles."""
    rounding_m: float = 0.1
    """Tolerance of the check of that gap over both sides: resampling rounds the shifted path."""
    hold_margin_m: float = 1.0
    """The full shift is held over this distance before and behind the obstacle."""
    edge_clearance_m: float = 0.2
    """Gap between the car's corners and the edge of the road."""
    min_ramp_m: float = 12.0
    """Minimum length of the transition where there is room for it."""
    lateral_acceleration: float = 2.0
    """[m/s2] Bound that determines the length of the transition."""
    braking: float = 3.0
    """[m/s2] Bound for slowing down before a shorter transition."""
    max_curvature: float = 0.18
    """[1/m] A radius of 5.5 m."""
    extra_shifts_m: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 1.0)
    """Additional lateral shifts to try: a turning car needs more room than its width."""
    shifted_m: float = 0.1
    """Points displaced by less are treated as unshifted."""


@dataclass(frozen=True, slots=True)
class AvoidanceParameters:
    """When the car leaves its path for obstacles, and where it waits until it can."""

    confirmation_s: float = 1.0
    """An obstacle must have been observed for this long: false positives disappear earlier."""
    suspected_s: float = 2.0
    """A vehicle that stands for this long may be parked: the car stops far enough behind it to turn out."""
    parked_s: float = 10.0
    """A vehicle that stands for this long is parked."""
    queue_radius_m: float = 8.0
    """A vehicle that stands this close to a moving one may be waiting for it."""
    moving_speed: float = 1.0
    """[m/s]"""
    turn_out_m: float = 10.0
    """Room before an obstacle in which a standing car can turn out."""
    hard_braking: float = 4.0
    """[m/s2]"""
    max_overshoot_m: float = 4.0
    """A car that would stop this much too late for turning out drives up to the obstacle."""
    passing_speed: float = 4.0
    """[m/s] Assumed minimum speed of the own car while it passes."""
    passing_acceleration: float = 2.0
    """[m/s2]"""
    time_reserve_s: float = 2.0
    """The detour must stay free for this much longer than passing takes."""
    stride_m: float = 0.5
    """Spacing of the own stations in the conflict test."""
    straight_on_m: float = 80.0
    """Other vehicles are predicted to drive straight on for this distance, in steps of `straight_on_step_m`."""
    straight_on_step_m: float = 2.0
    """Less than half the length of a car: successive boxes overlap."""
    memory_ticks: int = 3 * TICKS_PER_SECOND // 2
    """A conflict is remembered for this long: detectors miss objects for half a second, and one hides another."""
    creeping_speed: float = 1.5
    """[m/s] A slower car can still stop."""
    yield_gap_m: float = 3.0
    """Gap to the swept area of traffic that goes first."""
    side_gap_m: float = 0.3
    same_direction_cos: float = portable.cos(math.radians(60))
    follower_lateral_m: float = 1.5
    """A vehicle behind the car with a smaller lateral offset follows it."""

    @property
    def travelled(self) -> Float:
        """(D,) [m] distances at which other vehicles are predicted."""
        return np.arange(0.0, self.straight_on_m, self.straight_on_step_m)


@dataclass(frozen=True, slots=True)
class RightOfWayParameters:
    """Right of way by observation only: time-to-conflict, tie rules, patience."""

    look_ahead_m: float = 40.0
    """Previewed distance, on the own path and on the paths of others."""
    stride_m: float = 1.0
    """Spacing of the previewed stations, and of predicted positions of others."""
    side_gap_m: float = 0.25
    """Free space on either side of the own car."""
    moving_speed: float = 0.5
    """[m/s] A slower object stands and is assumed to arrive at this speed: later than any moving one."""
    conflict_gap_s: float = 1.0
    """Two cars that use the same area less than this apart are in conflict."""
    tie_s: float = 0.5
    """Arrival times that differ by less are a tie."""
    hysteresis_s: float = 1.5
    """A car that yields keeps yielding until the other one would arrive this much later."""
    same_direction_rad: float = math.radians(60)
    level_m: float = 0.5
    """Cars whose centres are less apart along the road are level."""
    max_curvature: float = 0.15
    """[1/m] Predicted turns are no sharper."""
    side_angles_rad: tuple[float, float] = (math.radians(20), math.radians(160))
    """Range of the relative heading of traffic from the side."""
    max_turn_rad: float = math.pi / 2
    patience_s: tuple[float, float] = (2.0, 8.0)
    """Range of the random time after which a waiting car insists on its turn: four polite cars would wait forever."""
    impatience_s: float = 3.0
    """How long it then insists."""


@dataclass(frozen=True, slots=True)
class MotionParameters:
    """Assumed behaviour of other road users."""

    reliable_s: float = 4.0
    """A moving object is not assumed to continue unchanged for longer."""
    acceleration: float = 2.0
    """[m/s2] Of a road user that goes first, up to `top_speed`."""
    top_speed: float = 8.0
    """[m/s]"""
    walking_top_speed: float = 3.0
    """[m/s] Of pedestrians."""
    hesitation_braking: float = 1.0
    """[m/s2] Of a road user that goes first but hesitates, for `hesitation_s`."""
    hesitation_s: float = 1.5
    """[s] Duration of that hesitation."""
    reaction_s: float = 0.3
    """Of a road user that yields, before it brakes with `yielding_braking`."""
    yielding_braking: float = 3.0
    """[m/s2] Of a road user that yields."""
    standing_speed: float = 0.2
    """[m/s] A slower road user stands."""
    max_turn_rad: float = math.pi / 2


@dataclass(frozen=True, slots=True)
class InteractionParameters:
    """The own car's reaction to predicted conflicts."""

    acceleration: float = 2.0
    """[m/s2] Assumed for the own arrival times."""
    crossing_gap_m: float = 2.0
    """Minimum distance between the waiting position and the shared area."""
    turning_room_m: float = 6.0
    """Room for a vehicle that turns although it was predicted to go straight on."""
    hard_braking: float = 4.0
    """[m/s2] The hardest braking of the planner."""
    min_wait_gap_m: float = 0.5
    """A waiting position lies at least this far beyond the point where the car could stop."""
    same_direction_rad: float = math.radians(45)


@dataclass(frozen=True, slots=True)
class StopLineParameters:
    """Where the box centre stops before a line."""

    sign_gap_m: float = 1.5
    """Before the line of a stop sign: inside its box."""
    light_gap_m: float = 3.0
    """Before the line of a red light: the front stays behind the line."""
    stopped_within_m: float = 1.5
    """A stop at most this far before the waiting position obeys the sign."""
    stopped_speed: float = 0.05
    """[m/s]"""
    yellow_braking: float = 4.0
    """[m/s2] A yellow light counts as red for a car that can stop before it with this deceleration."""


@dataclass(frozen=True, slots=True)
class PedestrianParameters:
    """Caution near standing pedestrians who face the road."""

    standing_speed: float = 0.1
    """[m/s]"""
    crossing_m: float = 14.0
    """Pedestrians are assumed to walk straight on for this distance, in steps of `crossing_step_m`."""
    crossing_step_m: float = 0.5
    """Less than a pedestrian's own size (0.6 m): no place is left out."""
    side_gap_m: float = 0.5
    stride_cells: int = 2
    """Every such cell of the path is compared."""
    creeping_speed: float = 3.0
    """[m/s] Minimum of the limit: a pedestrian who never steps out would stop the car forever."""
    braking: float = 1.5
    """[m/s2] The limit allows this gentle braking to a standstill `gap_m` before the pedestrian's path."""
    gap_m: float = 2.0
    """Distance before the pedestrian's path at which the car would stand."""
    started_m: float = 0.3
    """A pedestrian this far from the first observed position has started to cross."""
    walking_speed: float = 1.5
    """[m/s] Speed at which such a pedestrian continues."""


@dataclass(frozen=True, slots=True)
class ProfileParameters:
    """Search of speed profiles in space and time."""

    beyond_goal_m: float = 1.0
    """A profile ends this far beyond the goal: the goal must be passed."""
    forgiving_m: float = 1.5
    """So far ahead of a standing car, plus its stopping distance, a violated margin is forgiven."""
    idle_period_s: float = 24.0
    """A CAV that stands for 30 s is out (protocol 7.5): once in every such period a profile has to move."""
    idle_move_s: float = 1.5
    """For this long."""


@dataclass(frozen=True, slots=True)
class PlannerParameters:
    """The space-time planner of the baselines."""

    replan_ticks: int = 10
    """A new profile starts where the present one is on its own lattice: every half second."""
    check_ticks: int = 4
    """The present profile is checked at 5 Hz, the rate of the paper's planners."""
    check_s: float = 3.0
    """How far ahead the present profile is checked: from 8 m/s a car stands after 2 s with 4 m/s2."""
    lateral_acceleration: float = 3.0
    """[m/s2] Comfort in bends."""
    braking: float = 2.0
    """[m/s2] Comfort before bends."""
    min_margin: SafetyMargin = SafetyMargin(0.5, 0.1)
    """Kept where the whole margin is already violated: a waiting car does not creep up to the one ahead."""
    wait_penalty: float = 0.05
    """See `SpeedProfileProblem.wait_penalty`: a car that must wait closes up now, not at the last moment."""
    deadlock_ticks: int = 40
    """After standing for this long the planner uses `deadlock_margin`: two cars that wait close to each other must find
    a way past."""
    deadlock_margin: SafetyMargin = SafetyMargin(0.5, 0.1)
    stopped_speed: float = 0.05
    """[m/s] A slower car stands; in a queue its next profile begins where it is, not where its profile has it."""
    interval_s: float = 0.2
    """Spacing of plan points [s]."""
    plan_points: int = 50
    """10 s with `interval_s`: the horizon of the planner."""
    max_tracking_error_m: float = 0.8
    """A car further than this from the profile's station makes a new profile."""


@dataclass(frozen=True, slots=True)
class JointPlanningParameters:
    """Planning of all CAVs together from privileged knowledge."""

    left_world_m: float = 2.0
    """A CAV leaves the world when it passes its goal; this far beyond it has certainly left."""
    vehicle_prediction_s: float = 4.0
    """Background vehicles are predicted to go straight on for this long."""
    pedestrian_prediction_s: float = 12.0
    """Pedestrians are predicted to walk straight on for this long: 17 m at 1.4 m/s."""
    standing_speed: float = 0.1
    """[m/s]"""
    growth: float = 0.1
    """[m/s] Growth of a predicted box on every side."""
    detour_step_m: float = 10.0
    """Distance between the stations from which the rest of a path is searched for obstacles."""
    order_attempts: int = 24
    """Orders that `find_planning_order` tries."""


MARGINS = MarginParameters()
DETOUR = DetourParameters()
AVOIDANCE = AvoidanceParameters()
RIGHT_OF_WAY = RightOfWayParameters()
MOTION = MotionParameters()
INTERACTION = InteractionParameters()
STOP_LINE = StopLineParameters()
PEDESTRIAN = PedestrianParameters()
PROFILE = ProfileParameters()
PLANNER = PlannerParameters()
JOINT_PLANNING = JointPlanningParameters()
