"""Predicted boxes of moving road users on roads whose limits count, for many times at once."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.car_following import Travel, VehiclesAhead, find_vehicles_ahead, predict_travel
from mdrive_sumo.planning.parameters import JOINT_PLANNING
from mdrive_sumo.planning.road_direction import SHARP_TURN_RAD, RoadDirection, RoadPosition, find_lane_keeping

IN_LANE_M = 1.8
"""[m] A vehicle whose centre is less aside of the line straight ahead of another one is in its lane."""
LEADER_RANGE_M = 100.0
"""[m] Vehicles further ahead do not matter to a driver."""
SAME_DIRECTION_RAD = 0.6
"""A vehicle is a leader if it heads in the own direction up to this angle: 34 degrees, more than in a lane change."""


@dataclass(frozen=True, slots=True)
class TrafficParameters:
    """Parameters of the prediction. Design choices (decision 053)."""

    horizon_s: float = 10.0
    """Vehicles in lanes of the own direction are predicted for this long."""
    oncoming_horizon_s: float = 4.0
    """Oncoming vehicles are predicted for this long: many turn or brake before they arrive (measured on a left turn
    through dense traffic: 10 s costs 27 s of waiting, 4 s none, without contact). A fast own car needs longer."""
    crossing_horizon_s: float = 4.0
    """All other vehicles are predicted for this long at least."""
    review_horizon_s: float = 3.0
    """In the review of a plan, oncoming and crossing vehicles are predicted for this long: a car that has begun to
    enter a gap shall not stop because of a vehicle that can still brake."""
    own_braking: float = 4.0
    """[m/s2] All are predicted at least until the own car can stand with this deceleration, ..."""
    own_reaction_s: float = 2.0
    """... and so much longer: plans are reviewed twice a second, and a gentle stop is better than a hard one."""
    max_turn_rad: float = 0.12
    """A vehicle that turns away from the direction of the road by less keeps its lane: states are exact here, and a
    lane change ends."""
    headway_s: float = 0.9
    """Time gap kept behind a vehicle in the own lane: the plan is reviewed twice a second."""
    cav_gaps_s: tuple[float, ...] = (0.0, 0.35, 0.7)
    """Time gaps at which a place behind a CAV in the own lane is blocked: its plan is known, but it may change."""
    own_lane_m: float = 1.6
    """A vehicle with a smaller lateral offset is in the own lane."""


TRAFFIC = TrafficParameters()


@dataclass(frozen=True)
class MovingTraffic:
    """N moving road users near a road."""

    road: RoadDirection
    objects: Objects
    position: RoadPosition
    acceleration: Float
    """(N,) [m/s2] as observed."""
    others: Objects
    """Vehicles that stand, and CAVs: drivers brake behind them."""
    others_position: RoadPosition
    own_speed: float = 0.0
    """[m/s] Of the own car."""
    top_speed: float = 0.0
    """[m/s] Vehicles accelerate up to it."""
    headway_s: float = 0.0
    """[s] Time gap to keep behind those in the own lane."""
    is_review: bool = False
    """Whether a plan is reviewed; else one is made."""
    parameters: TrafficParameters = field(default=TRAFFIC)

    @cached_property
    def keeps_lane(self) -> Bool:
        """(N,)"""
        return find_lane_keeping(self.objects, self.position, self.parameters.max_turn_rad)

    @cached_property
    def forward(self) -> Float:
        """(N,) 1: in the direction of the road, -1: against it."""
        return np.where(np.abs(self.position.turned) < np.pi / 2, 1.0, -1.0)

    @cached_property
    def in_own_lane(self) -> Bool:
        """(N,)"""
        aside = np.abs(self.position.lateral)
        return self.keeps_lane & (self.forward > 0) & (aside < self.parameters.own_lane_m)

    @cached_property
    def horizons_s(self) -> Float:
        """(N,) time [s] for which each is predicted."""
        parameters, joint = self.parameters, JOINT_PLANNING
        stopping_s = self.own_speed / parameters.own_braking + parameters.own_reaction_s
        most_s = parameters.review_horizon_s if self.is_review else math.inf
        oncoming_s = max(min(parameters.oncoming_horizon_s, most_s), stopping_s)
        crossing_s = max(min(parameters.crossing_horizon_s, most_s), stopping_s)
        in_lanes_s = np.where(self.forward > 0, max(parameters.horizon_s, stopping_s), oncoming_s)
        is_vehicle = self.objects.kind == Kind.VEHICLE
        others_s = np.where(is_vehicle, crossing_s, joint.vehicle_prediction_s)
        others_s = np.where(self.objects.kind == Kind.PEDESTRIAN, joint.pedestrian_prediction_s, others_s)
        return np.where(self.keeps_lane, in_lanes_s, others_s)

    def predict_boxes(self, times: Float, step_s: float) -> tuple[Float, Bool]:
        """Return corners (T, N, 4, 2) [m] and a mask (T, N) of those whose prediction reaches so far.

        Boxes at `times` (T,) [s] cover where their road users are within `step_s` / 2 before and after.
        """
        lanes = self.keeps_lane, self.forward, self.in_own_lane
        limits = self.headway_s, step_s, JOINT_PLANNING.growth, SHARP_TURN_RAD
        travel = self._predict_travel(times)
        boxes, follows_turn = place_traffic(self.road, self.objects, self.position, travel, *lanes, times, *limits)
        is_early = (times[:, None] <= JOINT_PLANNING.vehicle_prediction_s) | (self.objects.kind == Kind.PEDESTRIAN)
        reaches = times[:, None] <= self.horizons_s
        return boxes, reaches & (~self.keeps_lane | follows_turn | is_early)

    def _predict_travel(self, times: Float) -> Travel:
        """Return what the N road users do until `times` (T,) [s]."""
        count = len(self.objects.ids)
        speed = np.append(self.objects.speed, self.others.speed)
        acceleration = np.append(self.acceleration, np.zeros(len(self.others.ids)))
        travel = predict_travel(speed, acceleration, self._find_ahead(), self.top_speed, times)
        return Travel(travel.distance[:, :count], travel.speed[:, :count])

    def _find_ahead(self) -> VehiclesAhead:
        """Return the vehicles ahead of the N road users and, none, of the others."""
        objects, count = self.objects, len(self.objects.ids)
        everything = objects.concat(self.others)
        dx, dy = everything.x - objects.x[:, None], everything.y - objects.y[:, None]
        cos, sin = (part[:, None] for part in portable.cos_sin(objects.yaw))
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        station = np.append(self.position.station, self.others_position.station)
        lateral = np.append(self.position.lateral, self.others_position.lateral)
        keeps = self.keeps_lane[:, None]
        along = np.where(keeps, self.forward[:, None] * (station - station[:count, None]), along)
        aside = np.where(keeps, lateral - lateral[:count, None], aside)
        same = portable.cos(everything.yaw - objects.yaw[:, None]) > portable.cos(SAME_DIRECTION_RAD)
        is_vehicle = everything.kind == Kind.VEHICLE
        is_ahead = (along > 0) & (along < LEADER_RANGE_M) & (np.abs(aside) < IN_LANE_M) & same & is_vehicle
        return find_vehicles_ahead(along, is_ahead, everything.length)


@twin
def place_traffic(
    road: RoadDirection,
    objects: Objects,
    position: RoadPosition,
    travel: Travel,
    keeps_lane: Bool,
    forward: Float,
    in_own_lane: Bool,
    times: Float,
    headway_s: float,
    step_s: float,
    growth: float,
    sharp_turn_rad: float,
    /,
) -> tuple[Float, Bool]:
    """Return the corners of `MovingTraffic.predict_boxes`, and a mask (T, N) of those whose road does not turn sharply.

    growth: of boxes [m/s].
    """
    grown = 2 * growth * times[:, None]
    travelled = np.where(objects.kind == Kind.VEHICLE, travel.distance, objects.speed * times[:, None])
    gap = np.where(in_own_lane, headway_s, 0.0) * travel.speed
    cos, sin = portable.cos_sin(objects.yaw)
    x, y = objects.x + travelled * cos, objects.y + travelled * sin
    here = np.broadcast_to(position.station, travelled.shape).ravel()
    there = here + (forward * travelled).ravel()
    moved = (road.get_points(there) - road.get_points(here)).reshape(*travelled.shape, 2)
    before, after = (road.get_yaw(s).reshape(travelled.shape) for s in (here, there))
    (cos, sin), (next_cos, next_sin) = portable.cos_sin(before), portable.cos_sin(after)
    follows_turn = np.abs(after - before) < sharp_turn_rad
    keeps, lateral = keeps_lane & follows_turn, position.lateral
    x = np.where(keeps, objects.x + moved[..., 0] - lateral * (next_sin - sin), x)
    y = np.where(keeps, objects.y + moved[..., 1] + lateral * (next_cos - cos), y)
    yaw = np.where(keeps, objects.yaw + after - before, objects.yaw)
    cos, sin = portable.cos_sin(yaw)
    x, y = x - gap / 2 * cos, y - gap / 2 * sin
    swept = np.where(in_own_lane, 0.0, travel.speed * step_s)  # the own car drives along with those
    boxes = boxes_corners(x, y, yaw, objects.length + gap + grown + swept, objects.width + grown)
    return boxes, follows_turn
