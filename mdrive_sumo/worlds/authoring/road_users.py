"""Road users of a scenario that is written by hand: CAVs, SUMO's vehicles, scripted ones, parked rows, props."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, get_args

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.roads import Lane, RoadMap, Route
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Action,
    Actor,
    HardBrake,
    KindName,
    LaneChange,
    LaneMotion,
    PathMotion,
    StandingMotion,
    Trigger,
)
from mdrive_sumo.worlds.authoring.route_steps import Point
from mdrive_sumo.worlds.traffic.vehicle_classes import VEHICLE_CLASSES, VehicleClass, build_vehicle

VehicleModel = Literal["car", "van", "truck", "bus", "motorcycle", "emergency"]
"""A class of `VEHICLE_CLASSES`."""
WALKER_SIZES: Mapping[KindName, tuple[float, float]] = {"pedestrian": (0.5, 0.5), "cyclist": (1.8, 0.6)}
"""Length and width [m]."""
WALKING_SPEED, CYCLING_SPEED = 1.4, 4.5
"""[m/s] Adults on foot (Highway Capacity Manual: 1.2 to 1.5) and cyclists in towns (15 to 20 km/h)."""
PARKING_GAP_M = 1.2
"""[m] Between bumpers of a parked row: bays of 5.8 m (US practice 5.5 to 6.7 m) for cars of 4.6 m."""
KERB_GAP_M = 0.25
"""[m] Between a parked vehicle and the lane beside it."""
RowSide = Literal["right", "left"]
Behaviour = Literal["start", "brake", "change-left", "change-right"]
"""What the trigger of a scripted vehicle sets off."""


def find_class(model: str) -> VehicleClass:
    """Return size and car following of a vehicle by model. Raises InputError."""
    if model not in VEHICLE_CLASSES:
        raise InputError(f"model: {describe_unknown(model, VEHICLE_CLASSES)}")
    return VEHICLE_CLASSES[model]


def build_cav(name: str, route: Route, start_speed: float = 0.0, time_limit_s: float | None = None) -> Ego:
    """Return a CAV on the first point of its route; points are rounded to 1 mm, as in files."""
    xy, yaws = route.xy.tolist(), route.yaw.tolist()
    points = tuple((round(x, 3), round(y, 3), round(yaw, 4)) for (x, y), yaw in zip(xy, yaws, strict=True))
    x, y, yaw = points[0]
    return Ego(
        id=name,
        start=Pose(x=x, y=y, yaw=yaw),
        start_speed=start_speed,
        time_limit_s=time_limit_s,
        lanes=route.lanes,
        route=points,
    )


def build_traffic_vehicle(
    name: str, roads: RoadMap, route: Route, model: str, speed: float, depart_s: float
) -> BackgroundVehicle:
    """Return a vehicle that SUMO drives along the roads of a route, from its start to the end of its last road."""
    lane = roads.lanes[route.lanes[0]]
    if lane.junction:
        raise InputError(f"start: expected a lane outside junctions, found {lane.id}")
    length = find_class(model).length
    edges = list(dict.fromkeys(roads.lanes[one].edge for one in route.lanes if not roads.lanes[one].junction))
    x, y = route.xy[0].tolist()
    front = lane.centre.project(x, y)[0] + length / 2
    if not length <= front <= lane.centre.length:
        raise InputError(
            f"start: expected room for its {length:g} m on lane {lane.id} of"
            f" {lane.centre.length:.1f} m, found its front at {front:.1f} m"
        )
    return build_vehicle(
        model,
        tuple(edges),
        id=name,
        depart_s=depart_s,
        depart_lane=lane.index,
        depart_pos_m=round(front, 2),
        depart_speed=speed,
    )


def build_scripted_vehicle(
    name: str, route: Route, model: str, speed: float, trigger: Trigger | None, behaviour: Behaviour
) -> Actor:
    """Return a vehicle that follows its lanes at a speed; a trigger sets off what `behaviour` names."""
    if behaviour not in get_args(Behaviour):
        raise InputError(f"then: {describe_unknown(behaviour, get_args(Behaviour))}")
    body = find_class(model)
    x, y = route.xy[0].tolist()
    waits = trigger is not None and behaviour == "start"
    return Actor(
        id=name,
        kind="vehicle",
        model=model,
        length=body.length,
        width=body.width,
        start=_make_pose(x, y, float(route.yaw[0])),
        motion=LaneMotion(lanes=route.lanes, speed=speed, start_speed=0.0 if waits else speed),
        trigger=trigger,
        action=None if trigger is None else _build_action(behaviour),
    )


def _build_action(behaviour: Behaviour) -> Action | None:
    match behaviour:
        case "start":
            return None  # that of a trigger without action
        case "brake":
            return HardBrake()
        case "change-left":
            return LaneChange(direction="left")
        case "change-right":
            return LaneChange(direction="right")


def build_walker(name: str, kind: KindName, points: Sequence[Point], speed: float, trigger: Trigger | None) -> Actor:
    """Return a pedestrian or cyclist that goes through points [m]: at once, or when triggered. Raises InputError."""
    if len(points) < 2:
        raise InputError(f"expected a start and a goal, found {len(points)} points")
    path = tuple((round(float(x), 3), round(float(y), 3)) for x, y in points)
    (x, y), (x1, y1) = path[:2]
    length, width = WALKER_SIZES[kind]
    return Actor(
        id=name,
        kind=kind,
        model="adult" if kind == "pedestrian" else "bicycle",
        length=length,
        width=width,
        start=_make_pose(x, y, portable.atan2(y1 - y, x1 - x)),
        motion=PathMotion(points=path, speed=speed),
        trigger=trigger,
    )


def build_parked_row(name: str, lane: Lane, between: tuple[float, float], model: str, side: RowSide) -> Iterator[Actor]:
    """Yield parked vehicles beside a lane, from one arc length [m] to another, as many as fit. Raises InputError."""
    body = find_class(model)
    length, width = body.length, body.width
    begin, end = between
    if beside := lane.left if side == "left" else lane.right:
        raise InputError(f"expected the edge of the road {side} of {lane.id}, found lane {beside}")
    if not 0.0 <= begin < end <= lane.centre.length + 1e-6:
        raise InputError(
            f"expected a stretch within 0 and {lane.centre.length:.1f} m of lane {lane.id}, found"
            f" {begin:.1f} to {end:.1f} m"
        )
    count = int((end - begin + PARKING_GAP_M) / (length + PARKING_GAP_M))
    if count < 1:
        raise InputError(f"expected at least {length:g} m for one {model}, found {end - begin:.1f} m")
    aside = (lane.width / 2 + KERB_GAP_M + width / 2) * (1.0 if side == "left" else -1.0)
    for number in range(count):
        s = begin + length / 2 + number * (length + PARKING_GAP_M)
        (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
        pose = _make_pose(x - aside * portable.sin(yaw), y + aside * portable.cos(yaw), yaw)
        yield Actor(
            id=f"{name}.{number}", kind="vehicle", model=f"parked-{model}", length=length, width=width, start=pose,
            motion=StandingMotion(),
        )  # fmt: skip


def build_prop(name: str, model: str, pose: Pose) -> Actor:
    """Return a static object. Raises InputError for a model that does not exist."""
    if model not in PROPS:
        raise InputError(f"model: {describe_unknown(model, PROPS)}")
    prop = PROPS[model]
    return Actor(id=name, kind=prop.kind, model=model, length=prop.length, width=prop.width, start=pose)


def _make_pose(x: float, y: float, yaw: float) -> Pose:
    return Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4))
