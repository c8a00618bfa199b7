"""Road users and props on the route of a CAV: groups that stand in or beside its lane, and those that move along it."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor, Motion, PathMotion, StandingMotion
from mdrive_sumo.worlds.encounters.crossing_users import LANE_M, WALKING_MPS, place_crossing_actors
from mdrive_sumo.worlds.encounters.proposed_actor import Lateral, ProposedActor
from mdrive_sumo.worlds.placement.bodies import BODIES, Body, build_actor
from mdrive_sumo.worlds.placement.lane_chains import build_pose, compute_route_pose

OBJECT_AHEAD_M = 38.0
"""[m] Distance ahead of a CAV's start of objects on a road without a junction."""
BEFORE_M, BEHIND_M = 9.0, 12.0
"""[m] Distance before the junction of `on_approach`, and behind it of `after_exit`."""
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
"""[m/s] By the words of a proposal; `normal` is the desired speed of CAVs (protocol 14.2), the others are chosen."""
WALKER = BODIES["adult"]._replace(length=0.6, width=0.6)
"""Body of people in proposals: the packaged scenarios have it."""
MOVING_BODIES: Mapping[str, Body] = {"walker": WALKER, "cyclist": BODIES["bicycle"], "npc_vehicle": BODIES["car"]}
SWERVE_M, BEND_RAD = 14, 0.6
"""[m], [rad] A route that turns by more than this within this distance before an obstacle leaves no room to swerve."""
MIN_PITCH_M, APART_M, GROUP_GAP_M = 2.2, 1.5, 0.5
"""[m] Least distance along the road between objects of a group, between groups, and between objects side by side."""
BESIDE_START_M, CLEAR_M = 4.0, 1.35
"""[m] A vehicle parked nearer than `NEAREST_M` to a CAV's start is at least this far ahead of it and this far beside
its path, half on the pavement."""
MIN_AHEAD_M, NEAREST_M = 22.0, 12.0
"""[m] Distance from a CAV's start to an obstacle on its route: room to see and avoid it; and the absolute minimum."""
AROUND_M = 10.0
"""[m] The lane in which an obstacle is passed must lie beside it this far before and behind it."""
CLOSED_M, PASSABLE_M = 1.2, 0.0
"""[m] How far to the left of the lane's centre line an obstacle may reach that is passed in the next lane, and one that
is passed in the own lane partly in the oncoming one: a car 2 m wide that keeps 0.5 m from it then still has its centre
nearer to its own lane."""


def place_actors(
    proposed: Sequence[ProposedActor], egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Return the actors of the scenario; `egos` are by the proposal's vehicle ids."""
    found: list[Actor] = []
    bodies = [_choose_body(actor, rng) for actor in proposed]
    filled: dict[tuple[str, str], float] = {}
    for actor, body in zip(proposed, bodies, strict=True):
        ego = egos[actor.affects_vehicle]
        if actor.motion == "cross_perpendicular":
            station = _find_station(actor, ego, roads, 0.0)
            found += place_crossing_actors(actor, (ego, station), roads, body, found)
            continue
        begin = filled.get(actor.place) or _find_station(actor, ego, roads, _compute_depth(actor, proposed, bodies))
        found += _build_along_route(actor, ego, roads, body, begin + body.length / 2)
        if actor.motion == "static":
            filled[actor.place] = begin + compute_group_length(actor, body) + APART_M
    return tuple(found)


def compute_group_length(actor: ProposedActor, body: Body) -> float:
    """Return the length of road [m] that a group occupies."""
    return body.length + (actor.quantity - 1) * _compute_pitch(actor, body)


def _compute_pitch(actor: ProposedActor, body: Body) -> float:
    """Return the distance [m] along the road from one object of a group to the next."""
    return 0.0 if actor.group_pattern == "across_lane" else max(body.length + 0.4, MIN_PITCH_M)


def _compute_depth(actor: ProposedActor, proposed: Sequence[ProposedActor], bodies: Sequence[Body]) -> float:
    """Return the length of road [m] of all groups at the position of this one."""
    return math.fsum(
        compute_group_length(other, body) + APART_M
        for other, body in zip(proposed, bodies, strict=True)
        if other.place == actor.place and other.motion == "static"
    )


def _find_station(actor: ProposedActor, ego: Ego, roads: RoadMap, depth: float) -> float:
    """Return the station on the CAV's route [m] of the actor and the `depth` metres behind it."""
    inside = [k for k, (x, y) in enumerate(ego.xy) if any(lane.junction for lane in roads.find_lanes_near(x, y, 0.3))]
    length = len(ego.route) - 1.0
    if not inside:
        return min(OBJECT_AHEAD_M, length * 0.6)
    if actor.timing_phase in ("after_exit", "after_turn", "after_merge"):
        return min(inside[-1] + BEHIND_M, length - 2.0)
    if actor.timing_phase == "in_intersection":
        return (inside[0] + inside[-1]) / 2
    before = inside[0] - BEFORE_M - depth
    if _is_parked_at_edge(actor):
        return max(before, BESIDE_START_M)
    if before >= MIN_AHEAD_M or inside[-1] + BEHIND_M + depth > length:
        return max(before, NEAREST_M)
    return max(inside[-1] + BEHIND_M, MIN_AHEAD_M) if depth else max(before, NEAREST_M)


def _build_along_route(actor: ProposedActor, ego: Ego, roads: RoadMap, body: Body, base: float) -> Iterator[Actor]:
    free = _find_parallel_lanes(ego, roads, base)
    offsets = _compute_offsets(actor, body.width)
    if _is_parked_at_edge(actor):  # of the road, not between two lanes
        near = base - body.length / 2 < NEAREST_M
        least = CLEAR_M + body.width / 2 if near else 0.0
        offsets = [min(offset, -least) - LANE_M * free[1] for offset in offsets]
    elif actor.motion == "static":
        offsets = shift_to_passable(offsets, body.width, free)
    for n, offset in enumerate(offsets):
        station = base + n * _compute_pitch(actor, body)
        start = build_pose(*compute_route_pose(ego, station, offset))
        yield build_actor(actor.name_member(n), body, start, motion=_build_motion(actor, ego, station, offset))


def _is_parked_at_edge(actor: ProposedActor) -> bool:
    """Return whether the vehicle is parked at the right edge of the road."""
    lateral = LATERAL[actor.start_lateral or actor.lateral_position]
    return actor.kind == "parked_vehicle" and actor.motion == "static" and lateral < LATERAL["half_right"]


def _compute_offsets(actor: ProposedActor, width: float) -> list[float]:
    """Return the offsets of a group to the left of the lane's centre line [m]."""
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
    """Return the offsets [m] such that objects of that width can be passed without driving in an oncoming lane
    (protocol 7.3).

    All are moved off the side where a lane of the same direction lies (`free`: left, right), or else off the left half
    of the lane. Objects on the right are mirrored where only that side is free.
    """
    left, right = free
    if max(map(abs, offsets)) > LANE_M / 2 + width / 2:
        return list(offsets)
    if right and not left:
        return [-offset for offset in shift_to_passable(offsets, width, (True, False))]
    least = min((CLOSED_M if left else PASSABLE_M) - width / 2 - max(offsets), 0.0)
    return [offset + least for offset in offsets]


def _find_parallel_lanes(ego: Ego, roads: RoadMap, station: float) -> tuple[bool, bool]:
    """Return whether a lane of the same direction lies to the left and to the right of the route around the station."""
    poses = [compute_route_pose(ego, station + ahead, 0.0) for ahead in (-AROUND_M, 0.0, AROUND_M)]
    return _has_parallel_lane(poses, roads, LANE_M), _has_parallel_lane(poses, roads, -LANE_M)


def _has_parallel_lane(poses: Sequence[tuple[float, float, float]], roads: RoadMap, offset: float) -> bool:
    points = np.array([(x - offset * portable.sin(yaw), y + offset * portable.cos(yaw)) for x, y, yaw in poses])
    near = roads.find_nearest_lanes(points)
    turned = portable.cos(near.yaw - np.array([yaw for _, _, yaw in poses]))
    outside = ~roads.in_junction[near.lane]
    return bool(((near.distance < LANE_M / 3) & (turned > 0))[outside].all()) and bool(outside.any())


def _choose_body(actor: ProposedActor, rng: random.Random) -> Body:
    if actor.kind in MOVING_BODIES:
        return MOVING_BODIES[actor.kind]
    return BODIES[
        rng.choice(("parked-car", "parked-van") if actor.kind == "parked_vehicle" else _find_prop_names(actor))
    ]


def _find_prop_names(actor: ProposedActor) -> tuple[str, ...]:
    """Return the props of a group: those named in its id, else cones for large groups and barriers or crates for small
    ones."""
    named = tuple(name for name in PROPS if name in actor.actor_id)
    return named or (("cone",) if actor.quantity > 3 else ("barrier", "crate"))


def _build_motion(actor: ProposedActor, ego: Ego, station: float, offset: float) -> Motion:
    if actor.motion == "static":
        return StandingMotion()
    forth = -1.0 if actor.direction_relative_to == "opposite" else 1.0
    reach = max(len(ego.route) - 1 - station, 20.0) if forth > 0 else station
    points = [compute_route_pose(ego, station + forth * d, offset)[:2] for d in np.arange(0.0, reach, 2.0)]
    speeds = WALKING_MPS if actor.kind == "walker" else DRIVE_MPS
    path = tuple((round(x, 3), round(y, 3)) for x, y in points)
    return PathMotion(points=path, speed=speeds[actor.speed])


def fit_to_lane_width(actor: Actor, roads: RoadMap) -> Actor:
    """Return an obstacle, moved to the right in a lane narrower than `LANE_M`, for which it was placed.

    There it leaves as much of the lane and its neighbour free as in a lane of that width.
    """
    start = actor.start
    lane = roads.driving[roads.find_nearest_lanes(np.array([[start.x, start.y]])).lane[0]]
    moved = build_pose(start.x, start.y, start.yaw, min(lane.width - LANE_M, 0.0))
    return actor.model_copy(update={"start": moved})


def is_behind_bend(actor: Actor, ego: Ego) -> bool:
    """Return whether the CAV's route turns much shortly before an obstacle: there is no room to swerve."""
    station = round(shapely.line_locate_point(shapely.LineString(ego.xy), shapely.Point(actor.start.x, actor.start.y)))
    yaws = ego.yaw[max(station - SWERVE_M, 0) : station + 1].tolist()
    return max(abs(wrap_angle(yaw - yaws[-1])) for yaw in yaws) > BEND_RAD
