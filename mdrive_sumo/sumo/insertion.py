"""How background vehicles come into SUMO: a vehicle type of their own, and the very place, time and speed of a log."""

# pyright: basic
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import libsumo
import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap, wrap_angle
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.sumo.logged_poses import LogPose
from mdrive_sumo.sumo.placed_vehicles import MATCH_M
from mdrive_sumo.sumo.schedule import ACTION_TICKS, Timetable
from mdrive_sumo.sumo.sumo_frames import angle_to_sumo, front_bumper

STANDARD = "DEFAULT_VEHTYPE"
EMERGENCY_DECEL = 9.0
"""[m/s2], SUMO's default; what a driver does who must."""
SLACK_M = 0.2
"""A log's vehicle may depart so near beside something [m]; parked cars and lanes are known no better."""
KEEP_CLEAR = "junctionModel.jmIgnoreKeepClearTime"
"""After how long [s] a driver enters a junction that SUMO thinks it cannot leave. The log knows that it can."""
NO_LIMIT = 10.0
"""Speed factor at departure: SUMO refuses vehicles that come faster than allowed. When it drives freely it is 1."""
REACTION_S = 0.3
"""Before a vehicle that has just departed brakes fully: until its first action, and one more."""
ON_LANE, AS_IT_IS = 1, 2
"""moveToXY's keepRoute: on the centre of a lane of its own route; or exactly there (sumo_pitfalls 1)."""
WAY_M = 3.0
"""How far [m] the centre line of a lane may be from a vehicle that is to drive on it."""


def type_of(vehicle: BackgroundVehicle) -> str:
    """SUMO's name of the type: SUMO's default where nothing is said, else one for each way to drive and size."""
    plain = (vehicle.driving, vehicle.length, vehicle.width, vehicle.schedule) == (CarFollowing(), 5.0, 1.8, None)
    kind = "scheduled" if vehicle.schedule else "logged" if vehicle.log else "free"
    return STANDARD if plain else f"{kind}:{vehicle.length}:{vehicle.width}:{vehicle.driving.model_dump_json()}"


def add_type(vehicle: BackgroundVehicle) -> None:
    """Makes the vehicle's type known to SUMO, unless it is."""
    name, driving, types = type_of(vehicle), vehicle.driving, libsumo.vehicletype
    if name in types.getIDList():
        return
    types.copy(STANDARD, name)
    types.setLength(name, vehicle.length)
    types.setWidth(name, vehicle.width)
    types.setTau(name, driving.tau_s)
    types.setMinGap(name, driving.min_gap_m)
    types.setAccel(name, driving.accel)
    types.setEmergencyDecel(name, max(EMERGENCY_DECEL, driving.decel))
    types.setDecel(name, driving.decel)
    types.setApparentDecel(name, driving.decel)
    types.setImperfection(name, driving.sigma)
    if vehicle.schedule is not None:
        types.setActionStepLength(name, ACTION_TICKS * DT)
        types.setParameter(name, KEEP_CLEAR, "0")
    if vehicle.schedule is not None or vehicle.log:
        types.setSpeedFactor(name, NO_LIMIT)
        types.setSpeedDeviation(name, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Berth:
    """Where and how a vehicle comes onto the road."""

    edge: str
    lane: int
    front: tuple[float, float, float]
    """Front bumper x, y [m], yaw [rad]."""
    speed: float
    since: float
    """Where along its schedule [m] that is."""
    keep_route: int
    centre: tuple[float, float]
    size: tuple[float, float]
    """Length and width of its box [m]."""
    waits: bool
    """Whether it stays away while something stands there; not if it was there before, on its log."""


def berth_of(vehicle: BackgroundVehicle, roads: RoadMap) -> Berth:
    """The place of its departure on the road; raises InputError where there is none.

    A schedule that begins at a distance over 0 begins so far ahead of the place of departure: in a junction.
    """
    since = vehicle.schedule.progress[0][1] if vehicle.schedule else 0.0
    lane, ahead = _lane_at(vehicle, since, roads)
    along = ahead * lane.centre.length / libsumo.lane.getLength(lane.id)
    x, y = lane.centre.at(along)
    yaw, back = lane.centre.yaw_at(along), vehicle.length / 2
    centre = x - math.cos(yaw) * back, y - math.sin(yaw) * back
    size = vehicle.length, vehicle.width
    return Berth(lane.edge, lane.index, (x, y, yaw), vehicle.depart_speed, since, ON_LANE, centre, size, True)


def _lane_at(vehicle: BackgroundVehicle, since: float, roads: RoadMap) -> tuple[Lane, float]:
    """The lane of a route at a distance from the place of departure, and how far along it [m], as SUMO measures."""
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    if lane is None:
        raise InputError(
            f"vehicle {vehicle.id}: expected a driving lane to depart on,"
            f" found lane {vehicle.depart_lane} of {vehicle.edges[0]}"
        )
    ahead = vehicle.depart_pos_m + since
    while since and ahead > (length := libsumo.lane.getLength(lane.id)):
        ways = route_lanes(vehicle.edges, roads)
        following = next((way for way in lane.successors if way in ways), None)
        if following is None:
            break
        lane, ahead = roads.lanes[following], ahead - length
    return lane, ahead


def berth_at(vehicle: BackgroundVehicle, pose: LogPose, tick: int, waits: bool, roads: RoadMap) -> Berth | None:
    """A berth right where its log has it in a tick; None off its route."""
    x, y = front_bumper(pose.x, pose.y, pose.yaw, vehicle.length)
    ways = route_lanes(vehicle.edges, roads)
    near = [lane for lane in roads.lanes_near(x, y, WAY_M) if lane.id in ways]
    if not near:
        return None
    lane = min(near, key=lambda one: abs(_beside(one, x, y, pose.yaw)))
    centre, size = (pose.x, pose.y), (vehicle.length, vehicle.width)
    since = Timetable(vehicle.schedule).place(tick) if vehicle.schedule else 0.0
    return Berth(lane.edge, lane.index, (x, y, pose.yaw), max(pose.speed, 0.0), since, AS_IT_IS, centre, size, waits)


def _beside(lane: Lane, x: float, y: float, yaw: float) -> float:
    """How badly a pose fits a lane: distance [m] from its centre line, and 1 m for every 0.2 rad of turning."""
    line = shapely.LineString(lane.centre.xy)
    point = shapely.Point(x, y)
    turned = abs(wrap_angle(yaw - lane.centre.yaw_at(line.project(point))))
    return float(line.distance(point)) + turned / 0.2


def route_lanes(edges: Sequence[str], roads: RoadMap) -> set[str]:
    """Ids of all lanes of a route, with the junction lanes from edge to edge."""
    ways = {lane.id for lane in roads.driving if lane.edge in edges}
    for edge, following in pairwise(edges):
        for lane in [lane for lane in roads.driving if lane.edge == edge]:
            ways |= {way for first in lane.successors for way in through(first, following, roads)}
    return ways


def through(lane: str, edge: str, roads: RoadMap) -> set[str]:
    """Ids of the junction lanes from `lane` on, if they lead to `edge`; else none."""
    passed: set[str] = set()
    while roads.lanes[lane].junction and lane not in passed:
        passed.add(lane)
        lane = next(iter(roads.lanes[lane].successors), lane)
    return passed if roads.lanes[lane].edge == edge else set()


def free(berth: Berth, others: Actors) -> bool:
    """Whether nobody stands there, nor so near before or behind that not even full braking helps."""
    if not berth.waits:
        return True
    *_, yaw = berth.front
    along = np.maximum(others.speed * np.cos(others.yaw - yaw), 0.0)
    needed = np.abs(berth.speed**2 - along**2) / (2 * EMERGENCY_DECEL) + REACTION_S * np.abs(berth.speed - along)
    ahead = np.where(along < berth.speed, needed, -needed) / 2
    x, y = berth.centre[0] + math.cos(yaw) * ahead, berth.centre[1] + math.sin(yaw) * ahead
    mine = boxes_corners(x, y, np.array(yaw), berth.size[0] + needed, np.array(berth.size[1] - 2 * SLACK_M))
    theirs = boxes_corners(others.x, others.y, others.yaw, others.length, others.width)
    return not boxes_overlap(mine, theirs).any()


def depart(vehicle: BackgroundVehicle, berth: Berth) -> None:
    """Puts it on the road in the coming step, without SUMO's judgement of whether that is safe."""
    x, y, yaw = berth.front
    libsumo.vehicle.add(vehicle.id, vehicle.id, typeID=type_of(vehicle), departSpeed=str(berth.speed))
    libsumo.vehicle.setSpeedMode(vehicle.id, 0)
    libsumo.vehicle.moveToXY(vehicle.id, berth.edge, berth.lane, x, y, angle_to_sumo(yaw), berth.keep_route, MATCH_M)
    libsumo.vehicle.setSpeed(vehicle.id, berth.speed)
