"""Road users that cross a CAV's route: where they wait, where they go, what hides them, and when they start."""

import random
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.proposed_actor import ProposedActor
from mdrive_sumo.worlds.placement.blind_driving import BLIND_ACCELERATION, BLIND_SPEED
from mdrive_sumo.worlds.placement.bodies import (
    BODIES,
    Body,
    build_actor,
    build_crossing_actor,
    build_distance_trigger,
    build_rider,
)
from mdrive_sumo.worlds.placement.lane_chains import (
    Spot,
    build_pose,
    compute_route_pose,
)

WALKING_MPS: Mapping[str, float] = {
    "slow": 1.0,
    "normal": 1.5,
    "fast": 2.5,
    "erratic": 2.0,
    "unknown": 1.5,
    "stopped": 0.0,
}
"""[m/s] By the words of a proposal; chosen around the walking speed of 1.34 m/s (Weidmann 1993): `fast` is running."""
CYCLING_MPS = 3.0
"""[m/s] Of cyclists who cross from a kerb, where they set off from rest; chosen."""
CROSSING_REACH_M = 18.0
"""[m] A proposed actor uses a zebra crossing within this distance."""
WAITING_M = 1.5
"""[m] Distance of its waiting position beyond the edge of the road."""
QUEUE_M, QUEUE_PITCH_M = 2.5, 0.9
"""[m] An actor that waits within this distance of others stands behind them, and how far."""
LANE_M = 3.5
"""[m] Width of a lane, for which proposals are placed."""
CROSSING_AHEAD_M = (20.0, 60.0)
"""[m] Distance from a CAV's start to where drawn road users cross."""
WALK_MPS, CYCLE_MPS = (0.9, 2.4), (2.5, 4.5)
"""Least and greatest speed [m/s] of a drawn pedestrian, and of a cyclist."""
KERB_M = 0.8
"""[m] Distance beyond the edge of the road at which drawn people wait."""
EARLY_S, HIDDEN_EARLY_S = (-0.3, 3.0), (0.6, 2.6)
"""[s] How long before blind driving would get there a crossing road user reaches the middle of the CAV's lane; of those
that a parked vehicle hides until then, late enough to matter and early enough to stop for."""
WIDEST_M = 18.0
"""[m] Roads whose edge is further away are not crossed."""
HIDES_M = (0.7, 1.4)
"""[m] Between a parked vehicle and the person that steps out behind it."""
TURN_OFF_M = 14.0
"""[m] A cyclist ahead leaves the road over this distance."""
ZEBRA_SHARE = 0.6
"""Share of road users that cross on a zebra crossing where the CAV's route has one."""
TRIES = 12
"""Places that are tried for one road user."""
Ends = tuple[Spot, Spot]


def place_crossing_actors(
    actor: ProposedActor, way: tuple[Ego, float], roads: RoadMap, body: Body, others: Sequence[Actor]
) -> Iterator[Actor]:
    """Return actors that cross the CAV's route, on the zebra crossing if there is one, triggered such that a blindly
    driven CAV meets them; `way`: the CAV and a station [m] on its route."""
    ego, station = way
    begin, end = _find_kerbs(actor, ego, roads, station)
    speed = WALKING_MPS[actor.speed] if actor.kind == "walker" else CYCLING_MPS
    yaw = portable.atan2(end[1] - begin[1], end[0] - begin[0])
    queue = sum(portable.distance((one.start.x, one.start.y), begin) < QUEUE_M for one in others)
    for n in range(actor.quantity):
        back = (queue + n) * QUEUE_PITCH_M
        first = begin[0] - back * portable.cos(yaw), begin[1] - back * portable.sin(yaw)
        met = shapely.LineString(ego.xy).intersection(shapely.LineString((first, end)))
        point = shapely.centroid(met) if not met.is_empty else shapely.Point(end)
        aside = portable.hypot(point.x - first[0], point.y - first[1])
        along = float(shapely.line_locate_point(shapely.LineString(ego.xy), point))
        speeding_m = 0.5 * (BLIND_SPEED * BLIND_SPEED) / BLIND_ACCELERATION
        rolling = min(BLIND_SPEED * (aside / max(speed, 0.1)), along - speeding_m)
        trigger = build_distance_trigger(ego, portable.hypot(rolling, aside))
        yield build_crossing_actor(actor.name_member(n), body, (first, end), speed, trigger)


def _find_kerbs(actor: ProposedActor, ego: Ego, roads: RoadMap, station: float) -> Ends:
    """Return where an actor waits and where it goes: the ends of a zebra crossing near the station, or both kerbs."""
    x, y, yaw = compute_route_pose(ego, station, 0.0)
    here, route = shapely.Point(x, y), shapely.LineString(ego.xy)
    zebras = [shapely.LineString(line) for line, _ in roads.crossings]
    near = [zebra for zebra in zebras if zebra.distance(here) < CROSSING_REACH_M and zebra.intersects(route)]
    if near:
        zebra = min(near, key=lambda zebra: zebra.distance(here))
        ends = [zebra.coords[0][:2], zebra.coords[-1][:2]]
    else:
        half = LANE_M * 1.5 + WAITING_M
        ends = [(x + s * half * portable.sin(yaw), y - s * half * portable.cos(yaw)) for s in (1.0, -1.0)]
    from_right = actor.crossing_direction == "right" or actor.lateral_position.endswith("right")
    ends.sort(key=lambda end: -portable.sin(yaw) * (end[0] - x) + portable.cos(yaw) * (end[1] - y))
    begin, end = (ends[0], ends[-1]) if from_right else (ends[-1], ends[0])
    out = portable.hypot(end[0] - begin[0], end[1] - begin[1])
    ux, uy = (end[0] - begin[0]) / out, (end[1] - begin[1]) / out
    return (begin[0] - ux, begin[1] - uy), (end[0] + ux, end[1] + uy)


class CrossingRequest(NamedTuple):
    """A road user that shall cross the route of some CAV."""

    model: str
    """Of `BODIES`: adult or bicycle."""
    is_hidden: bool
    """Whether a parked vehicle hides it."""


def build_crossing_users(
    roads: RoadMap,
    egos: Sequence[Ego],
    requests: Sequence[CrossingRequest],
    rng: random.Random,
    pace: float = BLIND_SPEED,
) -> Iterator[Actor]:
    """Return pedestrians and cyclists that cross the routes of drawn CAVs, and the vehicles that hide them.

    pace: speed [m/s] of a CAV that they would meet."""
    for number, (model, is_hidden) in enumerate(requests):
        ego, body = rng.choice(egos), BODIES[model]
        early_s = rng.uniform(*(HIDDEN_EARLY_S if is_hidden else EARLY_S))
        speed = round(rng.uniform(*(WALK_MPS if model == "adult" else CYCLE_MPS)), 2)
        zebras = [] if is_hidden else list(_find_zebras(roads, ego))
        if zebras and rng.random() < ZEBRA_SHARE:
            ends, met = rng.choice(zebras)
            ends = ends if rng.random() < 0.5 else (ends[1], ends[0])
        else:
            station = _draw_station(roads, ego, rng, pace / BLIND_SPEED)
            if station is None:
                continue
            side = -1.0 if is_hidden else rng.choice((-1.0, 1.0))
            begin, end = (find_road_edge(roads, ego, station, sign) for sign in (side, -side))
            if begin is None or end is None:
                continue
            if is_hidden:
                yield _build_hiding_vehicle(ego, station, begin, f"screen_{number}", rng)
            offsets = (side * (begin + KERB_M), -side * (end + KERB_M))
            first, last = (compute_route_pose(ego, station, offset)[:2] for offset in offsets)
            ends, met = (first, last), ego.route[station][:2]
        aside = portable.distance(ends[0], met)
        rolling = pace * (aside / speed + early_s)
        trigger = build_distance_trigger(ego, portable.hypot(max(rolling, 6.0), aside))
        yield build_crossing_actor(f"{body.kind}_{number}", body, ends, speed, trigger)


def _find_zebras(roads: RoadMap, ego: Ego) -> Iterator[tuple[Ends, Spot]]:
    """Return the zebra crossings on the CAV's route that it does not reach at once: ends, and where the route meets
    them."""
    route = shapely.LineString(ego.xy)
    for line, _ in roads.crossings:
        met = shapely.intersection(route, shapely.LineString(line))
        if not met.is_empty and shapely.line_locate_point(route, point := shapely.centroid(met)) > CROSSING_AHEAD_M[0]:
            (x0, y0), (x1, y1) = (line[k].tolist() for k in (0, -1))
            yield ((x0, y0), (x1, y1)), (float(point.x), float(point.y))


def _draw_station(roads: RoadMap, ego: Ego, rng: random.Random, stretch: float) -> int | None:
    """Return a station [m] on the CAV's route outside junctions; None if there is none."""
    first, last = int(stretch * CROSSING_AHEAD_M[0]), min(len(ego.route) - 8, int(stretch * CROSSING_AHEAD_M[1]))
    if last <= first:
        return None
    for _ in range(TRIES):
        station = rng.randint(first, last)
        near = roads.find_nearest_lanes(ego.xy[station][None])
        if not roads.in_junction[near.lane[0]]:
            return station
    return None


def find_road_edge(roads: RoadMap, ego: Ego, station: int, side: float) -> float | None:
    """Return the offset [m] from the route to the edge of the road on one side (1: left, -1: right), None if far."""
    offsets = np.arange(0.5, WIDEST_M, 0.25)
    points = np.array([compute_route_pose(ego, station, side * float(off))[:2] for off in offsets])
    near = roads.find_nearest_lanes(points)
    outside = near.distance > roads.lane_width[near.lane] / 2
    return float(offsets[int(np.argmax(outside))]) if outside.any() else None


def _build_hiding_vehicle(ego: Ego, station: int, edge: float, name: str, rng: random.Random) -> Actor:
    """Return a vehicle parked at the right edge of the road, directly before the station."""
    body = BODIES[rng.choice(("parked-van", "parked-car", "parked-van"))]
    back = station - rng.uniform(*HIDES_M) - BODIES["adult"].length / 2 - body.length / 2
    pose = build_pose(*compute_route_pose(ego, back, -(edge + rng.uniform(-0.1, 0.3) + body.width / 2)))
    return build_actor(name, body, pose)


def build_leading_cyclist(roads: RoadMap, ego: Ego, rng: random.Random) -> Actor | None:
    """Return a cyclist that rides ahead of the CAV at the right of its lane and leaves the road before its goal;
    None where the route is too short or the edge of the road too far."""
    station = rng.uniform(14.0, 30.0)
    edge = find_road_edge(roads, ego, len(ego.route) - 2, -1.0)
    if station > len(ego.route) - 25 or edge is None:
        return None
    stations = np.arange(station, len(ego.route) - 1.0, 2.0)
    offsets = np.interp(stations, (stations[-1] - TURN_OFF_M, stations[-1]), (rng.uniform(-1.2, -0.8), -edge - KERB_M))
    places = zip(stations.tolist(), offsets.tolist(), strict=True)
    first, second, *others = (build_pose(*compute_route_pose(ego, s, offset)) for s, offset in places)
    start = build_pose(first.x, first.y, portable.atan2(second.y - first.y, second.x - first.x))
    speed = round(rng.uniform(3.0, 5.5), 2)
    return build_rider("cyclist_ahead", BODIES["bicycle"], (start, second, *others), speed, round(speed * 0.8, 2))
