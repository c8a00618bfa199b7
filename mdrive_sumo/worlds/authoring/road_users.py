"""Road users of a scenario that is written by hand: SUMO's vehicles, scripted ones, parked rows, props,
and triggers: when one that waits sets off, or one that drives brakes or changes its lane.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Literal

from pydantic import ValidationError

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.roads import Lane, RoadMap, Route
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.scripted_actor import (
    Action,
    Actor,
    DistanceTrigger,
    HardBrake,
    LaneChange,
    LaneMotion,
    PositionTrigger,
    StartMotion,
    TimeTrigger,
    Trigger,
)
from mdrive_sumo.worlds.authoring.point_matching import match_point
from mdrive_sumo.worlds.authoring.route_steps import Point
from mdrive_sumo.worlds.placement.background_vehicles import DRIVING, build_background_vehicle, list_edges
from mdrive_sumo.worlds.placement.bodies import (
    BODIES,
    BODY_SIZES,
    build_actor,
    build_crossing_actor,
    build_parked_vehicle,
    build_rider,
)
from mdrive_sumo.worlds.placement.lane_chains import build_pose, compute_lane_pose

VehicleModel = Literal["car", "van", "truck", "bus"]
"""A vehicle of `DRIVING`."""
WALKING_SPEED, CYCLING_SPEED = 1.4, 4.5
"""[m/s] Adults on foot (Highway Capacity Manual: 1.2 to 1.5) and cyclists in towns (15 to 20 km/h)."""
PARKING_GAP_M = 1.2
"""[m] Between bumpers of a parked row: bays of 5.8 m (US practice 5.5 to 6.7 m) for cars of 4.6 m."""
KERB_GAP_M = 0.25
"""[m] Between a parked vehicle and the lane beside it."""
RowSide = Literal["right", "left"]
Behaviour = Literal["start", "brake", "change-left", "change-right"]
"""What the trigger of a scripted vehicle sets off."""
ACTIONS: Mapping[str, Action] = {
    "start": StartMotion(),
    "brake": HardBrake(),
    "change-left": LaneChange(direction="left"),
    "change-right": LaneChange(direction="right"),
}
"""Action of a trigger by behaviour."""


def build_traffic_vehicle(
    name: str, roads: RoadMap, route: Route, model: str, speed: float, depart_s: float
) -> BackgroundVehicle:
    """Return a vehicle that SUMO drives along the roads of a route, from its start to the end of its last road.

    Raises InputError for a start inside a junction, or without room on its lane.
    """
    lane = roads.lanes[route.lanes[0]]
    if lane.junction:
        raise InputError(f"start: expected a lane outside junctions, found {lane.id}")
    length = _get_length(model)
    x, y = route.xy[0].tolist()
    front = lane.centre.project(x, y)[0] + length / 2
    if not length <= front <= lane.centre.length:
        raise InputError(
            f"start: expected room for its {length:g} m on lane {lane.id} of {lane.centre.length:.1f} m, found"
            f" its front at {front:.1f} m"
        )
    vehicle = build_background_vehicle(
        model,
        list_edges(roads, route.lanes),
        lane.index,
        depart_s=depart_s,
        depart_pos_m=front,
        depart_speed=speed,
    )
    return vehicle.model_copy(update={"id": name})


def _get_length(model: str) -> float:
    """Return the length [m] of a vehicle by model. Raises InputError."""
    if model not in DRIVING:
        raise InputError(f"model: {describe_unknown(model, DRIVING)}")
    return BODY_SIZES[model][0]


def build_scripted_vehicle(
    name: str, route: Route, model: str, speed: float, trigger: Trigger | None, behaviour: str
) -> Actor:
    """Return a vehicle that follows its lanes at a speed; a trigger sets off what `behaviour` names."""
    _get_length(model)
    if behaviour not in ACTIONS:
        raise InputError(f"then: {describe_unknown(behaviour, ACTIONS)}")
    waits = trigger is not None and behaviour == "start"
    motion = LaneMotion(lanes=route.lanes, speed=speed, start_speed=0.0 if waits else speed)
    x, y = route.xy[0].tolist()
    start = build_pose(x, y, float(route.yaw[0]))
    action = None if trigger is None else ACTIONS[behaviour]
    return build_actor(name, BODIES[model], start, motion=motion, trigger=trigger, action=action)


def build_walker(name: str, model: str, points: Sequence[Point], speed: float, trigger: Trigger | None) -> Actor:
    """Return a pedestrian or cyclist that goes through points [m]: at once, or when triggered. Raises InputError."""
    if len(points) < 2:
        raise InputError(f"expected a start and a goal, found {len(points)} points")
    if trigger is not None:
        return build_crossing_actor(name, BODIES[model], points, speed, trigger)
    poses = [build_pose(x, y, portable.atan2(y1 - y, x1 - x)) for (x, y), (x1, y1) in pairwise(points)]
    return build_rider(name, BODIES[model], [*poses, build_pose(*points[-1], poses[-1].yaw)], speed)


def build_row(name: str, lane: Lane, between: tuple[float, float], model: str, side: RowSide) -> Iterator[Actor]:
    """Yield parked vehicles beside a lane, from one arc length [m] to another, as many as fit. Raises InputError."""
    length = _get_length(model)
    begin, end = between
    if beside := lane.left if side == "left" else lane.right:
        raise InputError(f"expected the edge of the road {side} of lane {lane.id}, found lane {beside}")
    if not 0.0 <= begin < end <= lane.centre.length + 1e-6:
        raise InputError(
            f"expected a stretch within 0 and {lane.centre.length:.1f} m of lane {lane.id}, found {begin:.1f} to"
            f" {end:.1f} m"
        )
    count = int((end - begin + PARKING_GAP_M) / (length + PARKING_GAP_M))
    if count < 1:
        raise InputError(f"expected at least {length:g} m for one {model}, found {end - begin:.1f} m")
    aside = (lane.width / 2 + KERB_GAP_M + BODY_SIZES[model][1] / 2) * (1.0 if side == "left" else -1.0)
    for number in range(count):
        pose = compute_lane_pose(lane, begin + length / 2 + number * (length + PARKING_GAP_M), aside)
        yield build_parked_vehicle(f"{name}.{number}", model, pose, mirrored=False)


def build_prop(name: str, roads: RoadMap, model: str, at: Point, yaw: float | None) -> Actor:
    """Return a static object at a point [m]; without a yaw [rad] it has that of the lane there. Raises InputError."""
    if model not in PROPS:
        raise InputError(f"model: {describe_unknown(model, PROPS)}")
    if yaw is None:
        spot = match_point(roads, at)
        yaw = roads.lanes[spot.lane].centre.yaw_at(spot.s)
    return build_actor(name, BODIES[model], build_pose(*at, yaw))


def near(cav: str, distance_m: float = 20.0) -> DistanceTrigger:
    """Fire when a CAV is within a distance [m], from centre to centre; 1 to 50 m. Raises InputError."""
    try:
        return DistanceTrigger(vehicle=cav, distance_m=distance_m)
    except ValidationError as error:
        raise InputError(f"near({cav!r}, {distance_m!r}): {describe_first_error(error)}") from None


def after(seconds: float) -> TimeTrigger:
    """Fire that many seconds after the start. Raises InputError."""
    try:
        return TimeTrigger(at_s=seconds)
    except ValidationError as error:
        raise InputError(f"after({seconds!r}): {describe_first_error(error)}") from None


def when_at(cav: str, point: tuple[float, float], radius_m: float = 3.0) -> PositionTrigger:
    """Fire when the centre of a CAV is within a circle around a point (x, y) [m]. Raises InputError."""
    try:
        return PositionTrigger(vehicle=cav, x=point[0], y=point[1], radius_m=radius_m)
    except (ValidationError, IndexError, TypeError) as error:
        is_value = isinstance(error, ValidationError)
        reason = describe_first_error(error) if is_value else "expected a point (x, y) in metres"
        raise InputError(f"when_at({cav!r}, {point!r}): {reason}") from None
