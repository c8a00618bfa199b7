"""Bodies of road users and things by model, and the scripted actors that have them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from mdrive_sumo.core import portable
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    KindName,
    PathMotion,
    StartMotion,
    Trigger,
)
from mdrive_sumo.worlds.placement.lane_chains import (
    Spot,
    build_pose,
)

BODY_SIZES: Mapping[str, tuple[float, float]] = {
    "car": (4.6, 1.85),
    "van": (5.9, 2.0),
    "truck": (9.5, 2.5),
    "bus": (12.0, 2.55),
    "articulated-bus": (18.0, 2.55),
    "semitrailer": (16.5, 2.55),
    "ambulance": (6.2, 2.1),
}
"""Length and width [m] of vehicles by model; widths without mirrors. The ambulance is that of EN 1789, type C,
rounded; the articulated bus and the semitrailer with its tractor are nearly as long as allowed (StVZO 32: 18.75 and
16.5 m)."""


class Body(NamedTuple):
    """What a road user or thing is for collisions."""

    model: str
    kind: KindName
    length: float
    """[m]"""
    width: float
    """[m]"""


BODIES: Mapping[str, Body] = {
    **{model: Body(model, "vehicle", *size) for model, size in BODY_SIZES.items()},
    "adult": Body("adult", "pedestrian", 0.5, 0.5),
    "bicycle": Body("bicycle", "cyclist", 1.8, 0.6),
    "e-scooter": Body("e-scooter", "cyclist", 1.2, 0.6),
    "motorcycle": Body("motorcycle", "vehicle", 2.2, 0.8),
    "moped": Body("moped", "vehicle", 1.8, 0.7),
    **{name: Body(name, prop.kind, prop.length, prop.width) for name, prop in PROPS.items()},
}
"""By model; two-wheelers with their riders."""


def build_actor(name: str, body: Body, start: Pose, **more: object) -> Actor:
    """Return a scripted actor; `more`: further fields of `Actor`. Without any it stands."""
    return Actor.model_validate({"id": name, **body._asdict(), "start": start, **more})


def build_parked_vehicle(name: str, model: str, pose: Pose, mirrored: bool = True) -> Actor:
    """Return a standing vehicle of a model of `BODY_SIZES`: parked, or stopped in a lane."""
    return build_actor(name, BODIES[model]._replace(model=f"parked-{model}"), pose, mirrored=mirrored)


def build_crossing_actor(
    name: str, body: Body, points: Sequence[Spot], speed: float, trigger: Trigger, **more: object
) -> Actor:
    """Return a road user that waits at the first point [m] and goes through the others when triggered."""
    (x, y), (x1, y1) = points[0], points[1]
    start = build_pose(x, y, portable.atan2(y1 - y, x1 - x))
    motion = PathMotion(points=tuple((round(px, 3), round(py, 3)) for px, py in points), speed=speed)
    return build_actor(name, body, start, motion=motion, trigger=trigger, action=StartMotion(), **more)


def build_rider(
    name: str, body: Body, poses: Sequence[Pose], speed: float, start_speed: float | None = None, **more: object
) -> Actor:
    """Return a road user that moves through poses, from the start on if `more` has no trigger.

    `start_speed` [m/s]: at first, if another one; `more`: further fields of `Actor`.
    """
    motion = PathMotion(
        points=tuple((pose.x, pose.y) for pose in poses),
        speed=speed,
        start_speed=speed if start_speed is None else start_speed,
    )
    return build_actor(name, body, poses[0], motion=motion, **more)


def build_mast(name: str, pose: Pose) -> RoadsideUnit:
    """Return a roadside unit at the position of a pose."""
    return RoadsideUnit(id=name, x=pose.x, y=pose.y)


def build_distance_trigger(ego: Ego, distance_m: float) -> DistanceTrigger:
    """Return a trigger that fires when a CAV is within a distance [m], at least 3 m and at most 50 m."""
    return DistanceTrigger(vehicle=ego.id, distance_m=round(min(max(distance_m, 3.0), 50.0), 2))
