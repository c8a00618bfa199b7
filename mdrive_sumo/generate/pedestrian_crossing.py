"""Actors that cross the road: where they wait at the kerb, where they go, and when they start."""

from collections.abc import Iterator, Mapping, Sequence

import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.generate.proposal import ProposedActor
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, DistanceTrigger, KindName, PathMotion, StartMotion, Trigger
from mdrive_sumo.worlds.placement.lane_chains import compute_route_pose
from mdrive_sumo.worlds.placement.spawn_points import BLIND_ACCELERATION, BLIND_SPEED

WALK_MPS: Mapping[str, float] = {
    "slow": 1.0,
    "normal": 1.5,
    "fast": 2.5,
    "erratic": 2.0,
    "unknown": 1.5,
    "stopped": 0.0,
}
CROSSING_REACH_M = 18.0
"""[m] A crossing actor uses a zebra crossing within this distance."""
KERB_M = 1.5
"""[m] Distance of the waiting position beyond the edge of the road."""
QUEUE_M = 2.5
"""[m] An actor that waits within this distance of others stands behind them."""
LANE_M = 3.5
ActorBody = tuple[str, KindName, tuple[float, float]]
"""Model, kind, and length and width [m]."""


def place_crossing_actors(
    actor: ProposedActor, way: tuple[Ego, float], roads: RoadMap, body: ActorBody, others: Sequence[Actor]
) -> Iterator[Actor]:
    """Return actors that cross the CAV's route, on the zebra crossing if there is one, triggered such that a blindly
    driven CAV meets them."""
    model, kind, size = body
    ego, station = way
    begin, end = _find_kerbs(actor, ego, roads, station)
    speed = WALK_MPS[actor.speed] if actor.kind == "walker" else 3.0
    yaw = portable.atan2(end[1] - begin[1], end[0] - begin[0])
    queue = sum(portable.distance((one.start.x, one.start.y), begin) < QUEUE_M for one in others)
    for n in range(actor.quantity):
        x, y = begin[0] - (queue + n) * 0.9 * portable.cos(yaw), begin[1] - (queue + n) * 0.9 * portable.sin(yaw)
        yield Actor(
            id=actor.actor_id if actor.quantity == 1 else f"{actor.actor_id}.{n}",
            kind=kind,
            model=model,
            length=size[0],
            width=size[1],
            start=Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4)),
            motion=PathMotion(points=((round(x, 3), round(y, 3)), (round(end[0], 3), round(end[1], 3))), speed=speed),
            trigger=_build_trigger(ego, (x, y), end, speed),
            action=StartMotion(),
        )


Spot = tuple[float, float]


def _find_kerbs(actor: ProposedActor, ego: Ego, roads: RoadMap, station: float) -> tuple[Spot, Spot]:
    x, y, yaw = compute_route_pose(ego, station, 0.0)
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
        ends = [(x + s * half * portable.sin(yaw), y - s * half * portable.cos(yaw)) for s in (1.0, -1.0)]
    from_right = actor.crossing_direction == "right" or actor.lateral_position.endswith("right")
    ends.sort(key=lambda end: -portable.sin(yaw) * (end[0] - x) + portable.cos(yaw) * (end[1] - y))
    begin, end = (ends[0], ends[-1]) if from_right else (ends[-1], ends[0])
    out = portable.hypot(end[0] - begin[0], end[1] - begin[1])
    ux, uy = (end[0] - begin[0]) / out, (end[1] - begin[1]) / out
    return (begin[0] - ux, begin[1] - uy), (end[0] + ux, end[1] + uy)


def _build_trigger(ego: Ego, begin: Spot, end: Spot, speed: float) -> Trigger:
    """Start when the CAV is as far away as blind driving covers until the actor is in its lane."""
    meet = shapely.LineString(ego.xy).intersection(shapely.LineString((begin, end)))
    point = shapely.centroid(meet) if not meet.is_empty else shapely.Point(end)
    walk_s = portable.hypot(point.x - begin[0], point.y - begin[1]) / max(speed, 0.1)
    along = float(shapely.line_locate_point(shapely.LineString(ego.xy), point))
    rolling = min(BLIND_SPEED * walk_s, along - 0.5 * (BLIND_SPEED * BLIND_SPEED) / BLIND_ACCELERATION)
    away = portable.hypot(rolling, portable.hypot(point.x - begin[0], point.y - begin[1]))
    return DistanceTrigger(vehicle=ego.id, distance_m=round(min(max(away, 3.0), 50.0), 2))
