"""Scripted road users of training scenarios: people and cyclists that cross, cyclists ahead, parked vehicles."""

import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import box_corners, wrap_angle
from mdrive_sumo.generate.pedestrian_crossing import LANE_M
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, DistanceTrigger, KindName
from mdrive_sumo.vehicle import dynamics
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_crossing_actor, build_rider
from mdrive_sumo.worlds.placement.lane_chains import build_pose, compute_lane_pose, compute_route_pose
from mdrive_sumo.worlds.placement.spawn_points import BLIND_SPEED

CAR = dynamics.MKZ_2017
CROSSING_AHEAD_M = (20.0, 60.0)
"""[m] Distance from a CAV's start to where road users cross."""
WALK_MPS, CYCLE_MPS = (0.9, 2.4), (2.5, 4.5)
"""Least and greatest speed [m/s] of a crossing pedestrian, and of a cyclist."""
KERB_M = 0.8
"""[m] Distance beyond the edge of the road at which people wait."""
EARLY_S, HIDDEN_EARLY_S = (-0.3, 3.0), (0.6, 2.6)
"""[s] How long before blind driving would get there a crossing road user reaches the middle of the CAV's lane; of those
that a parked vehicle hides until then, late enough to matter and early enough to stop for."""
WIDEST_M = 18.0
"""[m] Roads whose edge is further away are not crossed."""
BESIDE_ROUTE_M = 1.45
"""[m] Least distance of a parked vehicle from the centre line of any CAV's route."""
CLEAR_START_M = 6.0
"""[m] Added to the length of a CAV at its start: nothing is placed there."""
JUNCTION_M = 6.0
"""[m] Nothing parks nearer to the end of a lane."""
PARKED_NEAR_M = 70.0
"""[m] Vehicles park within this distance of the start of a CAV."""
PARKED_MODELS = {"parked-car": 0.68, "parked-van": 0.24, "parked-truck": 0.08}
"""Share of each model among parked vehicles; vans and trucks hide the most."""
HIDES_M = (0.7, 1.4)
"""[m] Between a parked vehicle and the person that steps out behind it."""
TURN_OFF_M = 14.0
"""[m] A cyclist ahead leaves the road over this distance."""
SWERVE_M, BEND_RAD = 14, 0.6
"""[m], [rad] A route that turns by more than this within this distance before an obstacle leaves no room to swerve."""
ZEBRA_SHARE = 0.6
"""Share of road users that cross on a zebra crossing where the CAV's route has one."""
TRIES = 12
"""Places that are tried for one road user."""
Spot = tuple[float, float]
"""x, y [m]."""
Ends = tuple[Spot, Spot]


def build_box(pose: Pose, length: float, width: float) -> shapely.Polygon:
    """Return a box as a polygon."""
    return shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, length, width))


def _find_road_edge(roads: RoadMap, ego: Ego, station: int, side: float) -> float | None:
    """Return the offset [m] from the route to the edge of the road on one side (1: left, -1: right), None if far."""
    offsets = np.arange(0.5, WIDEST_M, 0.25)
    points = np.array([compute_route_pose(ego, station, side * float(off))[:2] for off in offsets])
    near = roads.find_nearest_lanes(points)
    outside = near.distance > roads.lane_width[near.lane] / 2
    return float(offsets[int(np.argmax(outside))]) if outside.any() else None


def _draw_station(roads: RoadMap, ego: Ego, rng: random.Random) -> int | None:
    """Return a station [m] on the CAV's route outside junctions; None if there is none."""
    last = min(len(ego.route) - 8, int(CROSSING_AHEAD_M[1]))
    if last <= CROSSING_AHEAD_M[0]:
        return None
    for _ in range(TRIES):
        station = rng.randint(int(CROSSING_AHEAD_M[0]), last)
        near = roads.find_nearest_lanes(ego.xy[station][None])
        if not roads.in_junction[near.lane[0]]:
            return station
    return None


def build_crossing_users(
    roads: RoadMap, egos: Sequence[Ego], kinds: Sequence[tuple[KindName, bool]], rng: random.Random
) -> Iterator[Actor]:
    """Return pedestrians and cyclists that cross the routes of drawn CAVs; `kinds`: kind, and whether a parked vehicle
    hides the road user. That vehicle is returned too."""
    for number, (kind, is_hidden) in enumerate(kinds):
        ego = rng.choice(egos)
        early_s = rng.uniform(*(HIDDEN_EARLY_S if is_hidden else EARLY_S))
        speed = round(rng.uniform(*(WALK_MPS if kind == "pedestrian" else CYCLE_MPS)), 2)
        crosser = _Crosser(kind, f"{kind}_{number}", speed, early_s)
        zebras = [] if is_hidden else list(_find_zebras(roads, ego))
        if zebras and rng.random() < ZEBRA_SHARE:
            (one, other), met = rng.choice(zebras)
            ends = (one, other) if rng.random() < 0.5 else (other, one)
            yield _build_crosser(crosser, ego, ends, met)
            continue
        station = _draw_station(roads, ego, rng)
        if station is None:
            continue
        side = -1.0 if is_hidden else rng.choice((-1.0, 1.0))
        begin, end = (_find_road_edge(roads, ego, station, sign) for sign in (side, -side))
        if begin is None or end is None:
            continue
        if is_hidden:
            yield _build_hiding_vehicle(ego, station, begin, f"screen_{number}", rng)
        offsets = (side * (begin + KERB_M), -side * (end + KERB_M))
        x0, y0, x1, y1 = (v for offset in offsets for v in compute_route_pose(ego, station, offset)[:2])
        yield _build_crosser(crosser, ego, ((x0, y0), (x1, y1)), ego.route[station][:2])


def _find_zebras(roads: RoadMap, ego: Ego) -> Iterator[tuple[Ends, Spot]]:
    """Return the zebra crossings on the CAV's route that it does not reach at once: ends, and where the route meets
    them."""
    route = shapely.LineString(ego.xy)
    for line, _ in roads.crossings:
        met = shapely.intersection(route, shapely.LineString(line))
        if not met.is_empty and shapely.line_locate_point(route, point := shapely.centroid(met)) > CROSSING_AHEAD_M[0]:
            (x0, y0), (x1, y1) = (line[k].tolist() for k in (0, -1))
            yield ((x0, y0), (x1, y1)), (float(point.x), float(point.y))


class _Crosser(NamedTuple):
    """A road user that will cross."""

    kind: KindName
    id: str
    speed: float
    """[m/s]"""
    early_s: float
    """How long before a CAV that drives blindly it is on the CAV's route."""


def _build_crosser(crosser: _Crosser, ego: Ego, ends: Ends, met: Spot) -> Actor:
    """Return a road user that goes from one end to the other and meets the CAV's route at a point."""
    away = portable.distance(ends[0], met)
    rolling = BLIND_SPEED * (away / crosser.speed + crosser.early_s)
    distance = portable.hypot(max(rolling, 6.0), away)
    trigger = DistanceTrigger(vehicle=ego.id, distance_m=round(min(distance, 50.0), 2))
    body = BODIES["adult" if crosser.kind == "pedestrian" else "bicycle"]
    return build_crossing_actor(crosser.id, body, ends, crosser.speed, trigger)


def _build_hiding_vehicle(ego: Ego, station: int, edge: float, name: str, rng: random.Random) -> Actor:
    """Return a vehicle parked at the right edge of the road, directly before the station."""
    model = rng.choice(("parked-van", "parked-car", "parked-van"))
    body = BODIES[model]
    back = station - rng.uniform(*HIDES_M) - BODIES["adult"].length / 2 - body.length / 2
    pose = build_pose(*compute_route_pose(ego, back, -(edge + rng.uniform(-0.1, 0.3) + body.width / 2)))
    return build_actor(name, body, pose)


def build_leading_cyclist(roads: RoadMap, ego: Ego, rng: random.Random) -> Actor | None:
    """Return a cyclist that rides ahead of the CAV at the right of its lane and leaves the road before its goal;
    None where the route is too short or the edge of the road too far."""
    station = rng.uniform(14.0, 30.0)
    edge = _find_road_edge(roads, ego, len(ego.route) - 2, -1.0)
    if station > len(ego.route) - 25 or edge is None:
        return None
    stations = np.arange(station, len(ego.route) - 1.0, 2.0)
    offsets = np.interp(stations, (stations[-1] - TURN_OFF_M, stations[-1]), (rng.uniform(-1.2, -0.8), -edge - KERB_M))
    places = zip(stations.tolist(), offsets.tolist(), strict=True)
    first, second, *others = (build_pose(*compute_route_pose(ego, s, offset)) for s, offset in places)
    start = build_pose(first.x, first.y, portable.atan2(second.y - first.y, second.x - first.x))
    speed = round(rng.uniform(3.0, 5.5), 2)
    return build_rider("cyclist_ahead", BODIES["bicycle"], (start, second, *others), speed, round(speed * 0.8, 2))


def build_parked_vehicles(roads: RoadMap, egos: Sequence[Ego], count: int, rng: random.Random) -> Iterator[Actor]:
    """Return vehicles parked at the right edge of the road near the CAVs, mostly beside the lane."""
    starts = shapely.MultiPoint([(ego.start.x, ego.start.y) for ego in egos])
    area = starts.buffer(PARKED_NEAR_M)
    lanes = [
        lane
        for lane in roads.driving
        if not (lane.junction or lane.right) and area.intersects(shapely.LineString(lane.centre.xy))
    ]
    lanes = [lane for lane in lanes if lane.centre.length > 2 * JUNCTION_M + 9.0]
    for number in range(count if lanes else 0):
        lane = rng.choices(lanes, [lane.centre.length for lane in lanes])[0]
        yield _build_parked_vehicle(lane, f"parked_{number}", rng)


def _build_parked_vehicle(lane: Lane, name: str, rng: random.Random) -> Actor:
    model = rng.choices(list(PARKED_MODELS), list(PARKED_MODELS.values()))[0]
    body = BODIES[model]
    station = rng.uniform(JUNCTION_M + body.length / 2, lane.centre.length - JUNCTION_M - body.length / 2)
    offset = lane.width / 2 + body.width / 2 + rng.uniform(-0.3, 0.6)
    return build_actor(name, body, compute_lane_pose(lane, station, -offset))


def fit_to_lane_width(actor: Actor, roads: RoadMap) -> Actor:
    """Return an obstacle, moved to the right in a lane narrower than the 3.5 m for which `generate` places it.

    There it leaves as much of the lane and its neighbour free as in a lane of 3.5 m.
    """
    start = actor.start
    lane = roads.driving[roads.find_nearest_lanes(np.array([[start.x, start.y]])).lane[0]]
    missing = max(LANE_M - lane.width, 0.0)
    x, y = start.x + missing * portable.sin(start.yaw), start.y - missing * portable.cos(start.yaw)
    return actor.model_copy(update={"start": Pose(x=round(x, 3), y=round(y, 3), yaw=start.yaw)})


def is_behind_bend(actor: Actor, ego: Ego) -> bool:
    """Return whether the CAV's route turns much shortly before an obstacle: there is no room to swerve."""
    station = round(shapely.line_locate_point(shapely.LineString(ego.xy), shapely.Point(actor.start.x, actor.start.y)))
    yaws = ego.yaw[max(station - SWERVE_M, 0) : station + 1].tolist()
    return max(abs(wrap_angle(yaw - yaws[-1])) for yaw in yaws) > BEND_RAD


def select_free_actors(roads: RoadMap, egos: Sequence[Ego], actors: Sequence[Actor]) -> tuple[Actor, ...]:
    """Return the actors, in order, that overlap no building, CAV or earlier actor; parked ones also leave the CAVs'
    routes free."""
    routes = shapely.MultiLineString([ego.xy for ego in egos])
    taken = [build_box(ego.start, CAR.length + CLEAR_START_M, CAR.width) for ego in egos]
    chosen: list[Actor] = []
    for actor in actors:
        box = build_box(actor.start, actor.length, actor.width)
        is_parked = actor.id.startswith(("parked", "screen"))
        if any(box.intersects(other) for other in (*roads.building_shapes, *taken)):
            continue
        if is_parked and box.distance(routes) < BESIDE_ROUTE_M:
            continue
        taken.append(box)
        chosen.append(actor)
    return tuple(chosen)
