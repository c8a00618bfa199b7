"""Placing: the actors of a proposal become scripted road users and props on the route of the CAV that they concern."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mdrive_sumo.generate.pedestrian_crossing import (
    LANE_M,
    WALK_MPS,
    ActorBody,
    compute_route_pose,
    place_crossing_actors,
)
from mdrive_sumo.generate.proposal import Lateral, ProposedActor
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, Motion, PathMotion, StandingMotion

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
LEAST_PITCH_M, APART_M, GROUP_GAP_M = 2.2, 1.5, 0.5
"""Things of a group stand at least so far from each other along the road, groups behind each other have so much between
them, and things side by side so much [m]."""
BESIDE_START_M, CLEAR_M = 4.0, 1.35
"""Who parks nearer to a CAV's start than `NEAREST_M` does so at least that far ahead of it and that far beside its line
[m], half on the pavement."""
LEAST_AHEAD_M, NEAREST_M = 22.0, 12.0
"""From a CAV's start to what stands on its way: room to see it and turn out; at the very least [m]."""
AROUND_M = 10.0
"""[m] So far before and behind a thing the lane that one passes it in must lie beside it."""
CLOSED_M, PASSABLE_M = 1.2, 0.0
"""[m] How far to the left of the lane's centre line a thing may reach that is passed in the next lane, and one that is
passed in the own lane with part of the car in the oncoming one: a car 2 m wide that keeps 0.5 m from it then still has
its centre nearer to its own lane."""


def place_actors(
    proposed: Sequence[ProposedActor], egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Actors of the scenario; `egos` are by the proposal's vehicle ids."""
    found: list[Actor] = []
    bodies = [_body(actor, rng) for actor in proposed]
    filled: dict[tuple[str, str], float] = {}
    for actor, body in zip(proposed, bodies, strict=True):
        ego = egos[actor.affects_vehicle]
        if actor.motion == "cross_perpendicular":
            station = _station(actor, ego, roads, 0.0)
            found += place_crossing_actors(actor, (ego, station), roads, body, found)
            continue
        begin = filled.get(_spot(actor)) or _station(actor, ego, roads, _depth(actor, proposed, bodies))
        found += _along(actor, ego, roads, body, begin + body[2][0] / 2)
        if actor.motion == "static":
            filled[_spot(actor)] = begin + group_length(actor, body[2]) + APART_M
    return tuple(found)


def group_length(actor: ProposedActor, size: tuple[float, float]) -> float:
    """How much of the road [m] a group takes up."""
    return size[0] + (actor.quantity - 1) * _pitch(actor, size)


def _pitch(actor: ProposedActor, size: tuple[float, float]) -> float:
    """From one of a group to the next along the road [m]."""
    return 0.0 if actor.group_pattern == "across_lane" else max(size[0] + 0.4, LEAST_PITCH_M)


def _depth(actor: ProposedActor, proposed: Sequence[ProposedActor], bodies: Sequence[ActorBody]) -> float:
    """How much of the road [m] all take up that stand where this one does."""
    return sum(
        group_length(other, body[2]) + APART_M
        for other, body in zip(proposed, bodies, strict=True)
        if _spot(other) == _spot(actor) and other.motion == "static"
    )


def _spot(actor: ProposedActor) -> tuple[str, str]:
    return actor.affects_vehicle, actor.timing_phase


def _station(actor: ProposedActor, ego: Ego, roads: RoadMap, depth: float) -> float:
    """Where on the CAV's route [m] the actor, and what stands behind it for `depth` metres, belongs."""
    inside = [k for k, (x, y) in enumerate(ego.xy) if any(lane.junction for lane in roads.find_lanes_near(x, y, 0.3))]
    length = len(ego.route) - 1.0
    if not inside:
        return min(AHEAD_M, length * 0.6)
    if actor.timing_phase in ("after_exit", "after_turn", "after_merge"):
        return min(inside[-1] + BEHIND_M, length - 2.0)
    if actor.timing_phase == "in_intersection":
        return (inside[0] + inside[-1]) / 2
    before = inside[0] - BEFORE_M - depth
    if _at_edge(actor):
        return max(before, BESIDE_START_M)
    if before >= LEAST_AHEAD_M or inside[-1] + BEHIND_M + depth > length:
        return max(before, NEAREST_M)
    return max(inside[-1] + BEHIND_M, LEAST_AHEAD_M) if depth else max(before, NEAREST_M)


def _along(actor: ProposedActor, ego: Ego, roads: RoadMap, body: ActorBody, base: float) -> Iterator[Actor]:
    model, kind, size = body
    free = _beside(ego, roads, base)
    offsets = _offsets(actor, size[1])
    if _at_edge(actor):  # of the road, not between two lanes
        near = base - size[0] / 2 < NEAREST_M
        least = CLEAR_M + size[1] / 2 if near else 0.0
        offsets = [min(offset, -least) - LANE_M * free[1] for offset in offsets]
    elif actor.motion == "static":
        offsets = shift_to_passable(offsets, size[1], free)
    for n, offset in enumerate(offsets):
        station = base + n * _pitch(actor, size)
        x, y, yaw = compute_route_pose(ego, station, offset)
        yield Actor(
            id=actor.actor_id if actor.quantity == 1 else f"{actor.actor_id}.{n}",
            kind=kind,
            model=model,
            length=size[0],
            width=size[1],
            start=Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4)),
            motion=_motion(actor, ego, station, offset),
        )


def _at_edge(actor: ProposedActor) -> bool:
    """Whether it is parked at the right edge of the road."""
    lateral = LATERAL[actor.start_lateral or actor.lateral_position]
    return actor.kind == "parked_vehicle" and actor.motion == "static" and lateral < LATERAL["half_right"]


def _offsets(actor: ProposedActor, width: float) -> list[float]:
    """To the left of the lane's centre line [m], those of a group."""
    first = LATERAL[actor.start_lateral or actor.lateral_position] * LANE_M
    last = LATERAL[actor.end_lateral or actor.lateral_position] * LANE_M
    middle = (actor.quantity - 1) / 2
    if actor.group_pattern == "across_lane":
        apart = max(min(width + GROUP_GAP_M, (LANE_M - width) / max(2 * middle, 1)), width)
        return [first + (n - middle) * apart for n in range(actor.quantity)]
    if actor.group_pattern == "diagonal":
        return np.linspace(first, last, actor.quantity).tolist()
    return [first] * actor.quantity


def shift_to_passable(offsets: Sequence[float], width: float, free: tuple[bool, bool]) -> list[float]:
    """The offsets [m] of things of that width on the lane, so that they can be passed without driving in a lane of
    opposite direction (protocol 7.3): all moved off the side where a lane of the same direction lies, left and right;
    where there is none, off the left half of the lane. What belongs on the right is mirrored where only that is free.
    """
    left, right = free
    if max(map(abs, offsets)) > LANE_M / 2 + width / 2:
        return list(offsets)
    if right and not left:
        return [-offset for offset in shift_to_passable(offsets, width, (True, False))]
    least = min((CLOSED_M if left else PASSABLE_M) - width / 2 - max(offsets), 0.0)
    return [offset + least for offset in offsets]


def _beside(ego: Ego, roads: RoadMap, station: float) -> tuple[bool, bool]:
    """Whether a lane of the same direction lies to the left and to the right of the route around there."""
    poses = [compute_route_pose(ego, station + ahead, 0.0) for ahead in (-AROUND_M, 0.0, AROUND_M)]
    return _all_beside(poses, roads, LANE_M), _all_beside(poses, roads, -LANE_M)


def _all_beside(poses: Sequence[tuple[float, float, float]], roads: RoadMap, offset: float) -> bool:
    points = np.array([(x - offset * math.sin(yaw), y + offset * math.cos(yaw)) for x, y, yaw in poses])
    near = roads.find_nearest_lanes(points)
    turned = np.cos(near.yaw - np.array([yaw for _, _, yaw in poses]))
    outside = ~roads.in_junction[near.lane]
    return bool(((near.distance < LANE_M / 3) & (turned > 0))[outside].all()) and bool(outside.any())


def _body(actor: ProposedActor, rng: random.Random) -> ActorBody:
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


def _motion(actor: ProposedActor, ego: Ego, station: float, offset: float) -> Motion:
    if actor.motion == "static":
        return StandingMotion()
    forth = -1.0 if actor.direction_relative_to == "opposite" else 1.0
    reach = max(len(ego.route) - 1 - station, 20.0) if forth > 0 else station
    points = [compute_route_pose(ego, station + forth * d, offset)[:2] for d in np.arange(0.0, reach, 2.0)]
    speeds = WALK_MPS if actor.kind == "walker" else DRIVE_MPS
    path = tuple((round(x, 3), round(y, 3)) for x, y in points)
    return PathMotion(points=path, speed=speeds[actor.speed])
