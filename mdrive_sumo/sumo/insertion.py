"""Insertion of background vehicles into SUMO: vehicle types, and departure at the exact pose and speed of a log."""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import libsumo
import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap, wrap_angle
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.sumo.logged_poses import LoggedPose
from mdrive_sumo.sumo.placed_vehicles import MATCH_M
from mdrive_sumo.sumo.schedule import ACTION_TICKS, ScheduleTable
from mdrive_sumo.sumo.sumo_frames import compute_front_bumper, convert_yaw_to_sumo

STANDARD, CYCLE = "DEFAULT_VEHTYPE", "DEFAULT_BIKETYPE"
EMERGENCY_DECEL = 9.0
"""[m/s2] SUMO's default emergency deceleration."""
SLACK_M = 0.2
"""Tolerated lateral overlap [m] at departure: the accuracy of parked cars and lanes in a log."""
KEEP_CLEAR_PARAMETER = "junctionModel.jmIgnoreKeepClearTime"
"""SUMO's parameter: time [s] after which a driver enters a junction that it may not be able to leave."""
DEPARTURE_SPEED_FACTOR = 10.0
"""Speed factor at departure, because SUMO refuses vehicles above the speed limit. It is 1 while driving freely."""
REACTION_S = 0.3
"""Time [s] before a departed vehicle brakes fully: until its first action, and one more."""
ENTRY_M = 3.0
"""[m] A schedule names the lane on which a vehicle enters an edge at the first frame of its centre there: half its
length after its front bumper, and up to this much further: one frame of 0.1 s at 30 m/s."""
ON_LANE, EXACT_POSE = 1, 2
"""moveToXY's keepRoute: on the centre line of a lane of its route; or exactly at the pose (sumo_pitfalls 1)."""
MAX_LANE_DISTANCE_M = 3.0
"""Greatest distance [m] between a vehicle and the centre line of the lane that it is inserted on."""


def build_type_id(vehicle: BackgroundVehicle) -> str:
    """Return the vehicle type id: SUMO's default type, or one per driving style and dimensions."""
    if vehicle.kind == "cyclist":
        return f"cyclist:{vehicle.length}:{vehicle.width}:{vehicle.driving.model_dump_json()}"
    plain = (vehicle.driving, vehicle.length, vehicle.width, vehicle.schedule) == (CarFollowing(), 5.0, 1.8, None)
    kind = "scheduled" if vehicle.schedule else "logged" if vehicle.log else "free"
    return STANDARD if plain else f"{kind}:{vehicle.length}:{vehicle.width}:{vehicle.driving.model_dump_json()}"


def add_vehicle_type(vehicle: BackgroundVehicle) -> None:
    """Add the vehicle's type to SUMO unless it exists."""
    name, driving, types = build_type_id(vehicle), vehicle.driving, libsumo.vehicletype
    if name in types.getIDList():
        return
    types.copy(CYCLE if vehicle.kind == "cyclist" else STANDARD, name)
    types.setLength(name, vehicle.length)
    types.setWidth(name, vehicle.width)
    types.setTau(name, driving.tau_s)
    types.setMinGap(name, driving.min_gap_m)
    types.setAccel(name, driving.accel)
    types.setEmergencyDecel(name, max(EMERGENCY_DECEL, driving.decel))
    types.setDecel(name, driving.decel)
    types.setApparentDecel(name, driving.decel)
    types.setImperfection(name, driving.sigma)
    if driving.max_speed is not None:
        types.setMaxSpeed(name, driving.max_speed)
    if vehicle.schedule is not None:
        types.setActionStepLength(name, ACTION_TICKS * DT)
        types.setParameter(name, KEEP_CLEAR_PARAMETER, "0")
    if vehicle.schedule is not None or vehicle.log:
        types.setSpeedFactor(name, DEPARTURE_SPEED_FACTOR)
        types.setSpeedDeviation(name, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class InsertionPoint:
    """Pose, speed and lane at which a vehicle is inserted."""

    edge: str
    lane: int
    front_pose: tuple[float, float, float]
    """Front bumper x, y [m], yaw [rad]."""
    speed: float
    route_offset_m: float
    """Distance [m] along its schedule."""
    keep_route: int
    centre: tuple[float, float]
    dimensions: tuple[float, float]
    """Length and width [m]."""
    waits_for_gap: bool
    """Whether insertion waits for a gap; not if the vehicle was there before, on its log."""


def find_departure_point(vehicle: BackgroundVehicle, roads: RoadMap) -> InsertionPoint:
    """Return the departure point of a vehicle. Raises InputError if the lane does not exist.

    A schedule that begins at a distance > 0 begins that far ahead of the departure position, in a junction. The heading
    is that of the line from rear to front, both on the route: so SUMO computes it from the next step on, and a box that
    departs in a bend along the tangent would jump sideways in its second frame.
    """
    route_offset_m = vehicle.schedule.progress[0][1] if vehicle.schedule else 0.0
    passed = _find_departure_lanes(vehicle, route_offset_m, roads)
    lane, ahead = passed[-1]
    x, y = _find_lane_point(lane, ahead)
    back_x, back_y = _find_rear_point(passed, vehicle.length)
    yaw, back = portable.atan2(y - back_y, x - back_x), vehicle.length / 2
    cos, sin = portable.cos_sin(yaw)
    centre = x - cos * back, y - sin * back
    size = vehicle.length, vehicle.width
    return InsertionPoint(
        lane.edge, lane.index, (x, y, yaw), vehicle.depart_speed, route_offset_m, ON_LANE, centre, size, True
    )


def _find_lane_point(lane: Lane, along_m: float) -> tuple[float, float]:
    """Return the point [m] at an arc length on a lane as SUMO measures it."""
    return lane.centre.at(along_m * lane.centre.length / libsumo.lane.getLength(lane.id))


def _find_rear_point(passed: Sequence[tuple[Lane, float]], length: float) -> tuple[float, float]:
    """Return the point of the rear bumper; before the beginning of the first lane, on its extension."""
    left = length
    for lane, along in reversed(passed[1:]):
        if along >= left:
            return _find_lane_point(lane, along - left)
        left -= along
    lane, along = passed[0]
    return _find_lane_point(lane, along - left)


def _find_departure_lanes(
    vehicle: BackgroundVehicle, route_offset_m: float, roads: RoadMap
) -> list[tuple[Lane, float]]:
    """Return the lanes from the departure position to `route_offset_m` [m] ahead of it, each with the arc length [m],
    as SUMO measures, of the front bumper on it or of the lane's end."""
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    if lane is None:
        raise InputError(
            f"vehicle {vehicle.id}: expected a driving lane to depart on,"
            f" found lane {vehicle.depart_lane} of {vehicle.edges[0]}"
        )
    ahead = vehicle.depart_pos_m + route_offset_m
    passed: list[tuple[Lane, float]] = []
    while route_offset_m and ahead > (length := libsumo.lane.getLength(lane.id)):
        route_lane_ids = find_route_lanes(vehicle.edges, roads)
        onward = [lane_id for lane_id in lane.successors if lane_id in route_lane_ids]
        if not onward:
            break
        following = _find_scheduled_lane(vehicle, onward, roads)
        passed.append((lane, length))
        lane, ahead = roads.lanes[following], ahead - length
    return [*passed, (lane, ahead)]


def _find_scheduled_lane(vehicle: BackgroundVehicle, onward: Sequence[str], roads: RoadMap) -> str:
    """Return the one of the next lanes of a route that leads to the lane of the schedule; the first if none does.

    Several lanes of a junction may connect one lane with the lanes of the next edge. The schedule names the lane there
    where the edge begins, unless its index is that of the departure lane.
    """
    for lane_id in onward:
        lane, passed_m = roads.lanes[lane_id], roads.lanes[f"{vehicle.edges[0]}_{vehicle.depart_lane}"].centre.length
        while lane.junction and lane.successors:
            passed_m += lane.centre.length
            lane = roads.lanes[lane.successors[0]]
        entered_m = passed_m - vehicle.depart_pos_m + vehicle.length / 2 + ENTRY_M
        begun = [index for at_m, index in _list_lanes(vehicle) if at_m <= entered_m]
        if lane.index == (begun[-1] if begun else vehicle.depart_lane):
            return lane_id
    return onward[0]


def _list_lanes(vehicle: BackgroundVehicle) -> tuple[tuple[float, int], ...]:
    return vehicle.schedule.lanes if vehicle.schedule else ()


def find_takeover_point(
    vehicle: BackgroundVehicle, pose: LoggedPose, tick: int, waits_for_gap: bool, roads: RoadMap
) -> InsertionPoint | None:
    """Return the insertion point at the logged pose of a tick; None off its route."""
    x, y = compute_front_bumper(pose.x, pose.y, pose.yaw, vehicle.length)
    route_lane_ids = find_route_lanes(vehicle.edges, roads)
    near = [lane for lane in roads.find_lanes_near(x, y, MAX_LANE_DISTANCE_M) if lane.id in route_lane_ids]
    if not near:
        return None
    lane = min(near, key=lambda one: abs(_compute_lane_misfit(one, x, y, pose.yaw)))
    centre, size = (pose.x, pose.y), (vehicle.length, vehicle.width)
    route_offset_m = ScheduleTable(vehicle.schedule).find_position(tick) if vehicle.schedule else 0.0
    return InsertionPoint(
        lane.edge,
        lane.index,
        (x, y, pose.yaw),
        max(pose.speed, 0.0),
        route_offset_m,
        EXACT_POSE,
        centre,
        size,
        waits_for_gap,
    )


def _compute_lane_misfit(lane: Lane, x: float, y: float, yaw: float) -> float:
    """Return the misfit of a pose and a lane: distance [m] from the centre line, plus 1 m per 0.2 rad of heading."""
    line = shapely.LineString(lane.centre.xy)
    point = shapely.Point(x, y)
    turned = abs(wrap_angle(yaw - lane.centre.yaw_at(line.project(point))))
    return float(line.distance(point)) + turned / 0.2


def find_route_lanes(edges: Sequence[str], roads: RoadMap) -> set[str]:
    """Return the ids of all lanes of a route, including the junction lanes between its edges."""
    route_lane_ids = {lane.id for lane in roads.driving if lane.edge in edges}
    for edge, following in pairwise(edges):
        for lane in [lane for lane in roads.driving if lane.edge == edge]:
            route_lane_ids |= {
                lane_id for first in lane.successors for lane_id in find_junction_lanes(first, following, roads)
            }
    return route_lane_ids


def find_junction_lanes(lane: str, edge: str, roads: RoadMap) -> set[str]:
    """Return the ids of the junction lanes that lead from `lane` to `edge`; empty if they do not."""
    passed: set[str] = set()
    while roads.lanes[lane].junction and lane not in passed:
        passed.add(lane)
        lane = next(iter(roads.lanes[lane].successors), lane)
    return passed if roads.lanes[lane].edge == edge else set()


def is_free(point: InsertionPoint, road_users: Actors) -> bool:
    """Return whether the point is free, with gaps ahead and behind that full braking can keep."""
    if not point.waits_for_gap:
        return True
    *_, yaw = point.front_pose
    along = np.maximum(road_users.speed * portable.cos(road_users.yaw - yaw), 0.0)
    braking_m = np.abs(point.speed * point.speed - along * along) / (2 * EMERGENCY_DECEL)
    needed = braking_m + REACTION_S * np.abs(point.speed - along)
    ahead = np.where(along < point.speed, needed, -needed) / 2
    cos, sin = portable.cos_sin(yaw)
    x, y = point.centre[0] + cos * ahead, point.centre[1] + sin * ahead
    own_boxes = boxes_corners(
        x, y, np.array(yaw), point.dimensions[0] + needed, np.array(point.dimensions[1] - 2 * SLACK_M)
    )
    other_boxes = boxes_corners(road_users.x, road_users.y, road_users.yaw, road_users.length, road_users.width)
    return not boxes_overlap(own_boxes, other_boxes).any()


def insert_vehicle(vehicle: BackgroundVehicle, point: InsertionPoint) -> None:
    """Insert a vehicle in the coming step, without SUMO's safety check."""
    x, y, yaw = point.front_pose
    libsumo.vehicle.add(vehicle.id, vehicle.id, typeID=build_type_id(vehicle), departSpeed=str(point.speed))
    libsumo.vehicle.setSpeedMode(vehicle.id, 0)
    libsumo.vehicle.moveToXY(
        vehicle.id, point.edge, point.lane, x, y, convert_yaw_to_sumo(yaw), point.keep_route, MATCH_M
    )
    libsumo.vehicle.setSpeed(vehicle.id, point.speed)
