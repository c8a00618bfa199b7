"""Placing: the actors of a proposal become scripted road users and props on the route of the CAV that they concern."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.generate.proposal import Lateral, ProposedActor
from mdrive_sumo.generate.spawn import BLIND_ACCELERATION, BLIND_SPEED
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.actor import Actor, AlongPath, DistanceTrigger, KindName, Motion, StartMotion, Trigger
from mdrive_sumo.scenario.part import Pose
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.spec import Ego

AHEAD_M = 38.0
"""How far ahead of a CAV's start things stand on a road without a junction."""
BEFORE_M, BEHIND_M = 9.0, 12.0
"""How far before the junction `on_approach` is, and behind it `after_exit` [m]."""
LATERAL: Mapping[Lateral, float] = {
    "center": 0.0,
    "half_right": -0.25,
    "right_edge": -0.5,
    "offroad_right": -0.85,
    "sidewalk_right": -1.1,
    "half_left": 0.25,
    "left_edge": 0.5,
    "offroad_left": 0.85,
    "sidewalk_left": 1.1,
}
"""Offset from the lane's centre line as a share of its width; left is positive."""
WALK_MPS: Mapping[str, float] = {
    "slow": 1.0,
    "normal": 1.5,
    "fast": 2.5,
    "erratic": 2.0,
    "unknown": 1.5,
    "stopped": 0.0,
}
DRIVE_MPS: Mapping[str, float] = {
    "slow": 4.0,
    "normal": 8.0,
    "fast": 11.0,
    "erratic": 9.0,
    "unknown": 8.0,
    "stopped": 0.0,
}
WALKER_SIZE, CYCLIST_SIZE, CAR_SIZE = (0.6, 0.6), (1.8, 0.6), (4.6, 1.85)
"""Length and width [m]."""
CROSSING_REACH_M = 18.0
"""Who crosses near a zebra crossing takes it."""
KERB_M = 1.5
"""How far beyond the road's edge somebody waits."""
LANE_M = 3.5


def actors_of(
    proposed: Sequence[ProposedActor], egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Actors of the scenario; `egos` are by the proposal's vehicle ids."""
    found: list[Actor] = []
    for actor in proposed:
        ego = egos[actor.affects_vehicle]
        made = (
            _crossing(actor, ego, roads, rng)
            if actor.motion == "cross_perpendicular"
            else _along(actor, ego, roads, rng)
        )
        found += list(made)
    return tuple(found)


def _station(actor: ProposedActor, ego: Ego, roads: RoadMap) -> float:
    """Where on the CAV's route [m] the actor belongs."""
    inside = [k for k, (x, y) in enumerate(ego.xy) if any(lane.junction for lane in roads.lanes_near(x, y, 0.3))]
    length = len(ego.route) - 1.0
    if not inside:
        return min(AHEAD_M, length * 0.6)
    if actor.timing_phase in ("after_exit", "after_turn", "after_merge"):
        return min(inside[-1] + BEHIND_M, length - 2.0)
    if actor.timing_phase == "in_intersection":
        return (inside[0] + inside[-1]) / 2
    return max(inside[0] - BEFORE_M, 10.0)


def _at(ego: Ego, station: float, offset: float) -> tuple[float, float, float]:
    """Pose [m, m, rad] beside the route, `offset` to its left."""
    k = min(max(round(station), 0), len(ego.route) - 1)
    x, y, yaw = ego.route[k]
    along = station - k
    x, y = x + along * math.cos(yaw), y + along * math.sin(yaw)
    return x - offset * math.sin(yaw), y + offset * math.cos(yaw), yaw


def _along(actor: ProposedActor, ego: Ego, roads: RoadMap, rng: random.Random) -> Iterator[Actor]:
    model, kind, size = _body(actor, rng)
    base = _station(actor, ego, roads)
    first = LATERAL[actor.start_lateral or actor.lateral_position] * LANE_M
    last = LATERAL[actor.end_lateral or actor.lateral_position] * LANE_M
    for n in range(actor.quantity):
        share = n / max(actor.quantity - 1, 1)
        station, offset = base, first
        if actor.group_pattern == "across_lane":
            offset = first + (share - 0.5) * (LANE_M - size[1]) * (actor.quantity > 1)
        elif actor.group_pattern == "diagonal":
            station, offset = base + n * 2.5, first + share * (last - first)
        else:
            station = base + n * (size[0] + 1.0)
        x, y, yaw = _at(ego, station, offset)
        yield Actor(
            id=actor.actor_id if actor.quantity == 1 else f"{actor.actor_id}.{n}",
            kind=kind,
            model=model,
            length=size[0],
            width=size[1],
            start=Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4)),
            **_motion(actor, ego, station, offset),
        )


def _body(actor: ProposedActor, rng: random.Random) -> tuple[str, KindName, tuple[float, float]]:
    if actor.kind == "walker":
        return "adult", "pedestrian", WALKER_SIZE
    if actor.kind == "cyclist":
        return "bicycle", "cyclist", CYCLIST_SIZE
    if actor.kind == "npc_vehicle":
        return "car", "vehicle", CAR_SIZE
    names = ("parked-car", "parked-van") if actor.kind == "parked_vehicle" else _things(actor)
    name = rng.choice(names)
    return name, PROPS[name].kind, (PROPS[name].length, PROPS[name].width)


def _things(actor: ProposedActor) -> tuple[str, ...]:
    """Which prop a group is made of: what its name says, else cones for many and crates for few."""
    named = tuple(name for name in PROPS if name in actor.actor_id)
    return named or (("cone",) if actor.quantity > 3 else ("barrier", "crate"))


def _motion(actor: ProposedActor, ego: Ego, station: float, offset: float) -> dict[str, Motion]:
    if actor.motion == "static":
        return {}
    forth = -1.0 if actor.direction_relative_to == "opposite" else 1.0
    reach = max(len(ego.route) - 1 - station, 20.0) if forth > 0 else station
    points = [_at(ego, station + forth * d, offset)[:2] for d in np.arange(0.0, reach, 2.0)]
    speeds = WALK_MPS if actor.kind == "walker" else DRIVE_MPS
    path = tuple((round(x, 3), round(y, 3)) for x, y in points)
    return {"motion": AlongPath(points=path, speed=speeds[actor.speed])}


def _crossing(actor: ProposedActor, ego: Ego, roads: RoadMap, rng: random.Random) -> Iterator[Actor]:
    """Walks across the CAV's way, on the zebra crossing if there is one, set off so that blind driving meets it."""
    model, kind, size = _body(actor, rng)
    station = _station(actor, ego, roads)
    begin, end = _kerbs(actor, ego, roads, station)
    speed = WALK_MPS[actor.speed] if actor.kind == "walker" else 3.0
    yaw = math.atan2(end[1] - begin[1], end[0] - begin[0])
    for n in range(actor.quantity):
        x, y = begin[0] - n * 0.9 * math.cos(yaw), begin[1] - n * 0.9 * math.sin(yaw)
        yield Actor(
            id=actor.actor_id if actor.quantity == 1 else f"{actor.actor_id}.{n}",
            kind=kind,
            model=model,
            length=size[0],
            width=size[1],
            start=Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4)),
            motion=AlongPath(points=((round(x, 3), round(y, 3)), (round(end[0], 3), round(end[1], 3))), speed=speed),
            trigger=_trigger(ego, (x, y), end, speed),
            action=StartMotion(),
        )


Spot = tuple[float, float]


def _kerbs(actor: ProposedActor, ego: Ego, roads: RoadMap, station: float) -> tuple[Spot, Spot]:
    x, y, yaw = _at(ego, station, 0.0)
    near = [
        line for line, _ in roads.crossings if shapely.LineString(line).distance(shapely.Point(x, y)) < CROSSING_REACH_M
    ]
    route = shapely.LineString(ego.xy)
    near = [line for line in near if shapely.LineString(line).intersects(route)]
    if near:
        line = min(near, key=lambda line: shapely.LineString(line).distance(shapely.Point(x, y)))
        ends = [(float(px), float(py)) for px, py in (line[0], line[-1])]
    else:
        half = LANE_M * 1.5 + KERB_M
        ends = [(x + s * half * math.sin(yaw), y - s * half * math.cos(yaw)) for s in (1.0, -1.0)]
    from_right = actor.crossing_direction == "right" or actor.lateral_position.endswith("right")
    ends.sort(key=lambda end: -math.sin(yaw) * (end[0] - x) + math.cos(yaw) * (end[1] - y))
    begin, end = (ends[0], ends[-1]) if from_right else (ends[-1], ends[0])
    out = math.hypot(end[0] - begin[0], end[1] - begin[1])
    ux, uy = (end[0] - begin[0]) / out, (end[1] - begin[1]) / out
    return (begin[0] - ux, begin[1] - uy), (end[0] + ux, end[1] + uy)


def _trigger(ego: Ego, begin: Spot, end: Spot, speed: float) -> Trigger:
    """When the CAV is as far away as blind driving covers until the walker is in its lane."""
    meet = shapely.LineString(ego.xy).intersection(shapely.LineString((begin, end)))
    point = shapely.centroid(meet) if not meet.is_empty else shapely.Point(end)
    walk_s = math.hypot(point.x - begin[0], point.y - begin[1]) / max(speed, 0.1)
    along = float(shapely.line_locate_point(shapely.LineString(ego.xy), point))
    rolling = min(BLIND_SPEED * walk_s, along - 0.5 * BLIND_SPEED**2 / BLIND_ACCELERATION)
    away = math.hypot(rolling, math.hypot(point.x - begin[0], point.y - begin[1]))
    return DistanceTrigger(vehicle=ego.id, distance_m=round(min(max(away, 3.0), 50.0), 2))
