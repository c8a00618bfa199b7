"""Placing the actors of pre-crash scenarios: who crosses, leads, pulls out or does not yield, and what hides them."""

import math
import random
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.generate.actor_placement import CAR_SIZE, CYCLIST_SIZE, DRIVE_MPS, WALK_MPS, WALKER_SIZE, place_actors
from mdrive_sumo.generate.lane_routes import LaneRoute, find_lane_change_routes, find_lane_routes
from mdrive_sumo.generate.pre_crash_spawn_points import compute_arrival_s, locate_junction
from mdrive_sumo.generate.proposal import Lateral, ProposedActor
from mdrive_sumo.generate.spawn_points import RIM_M, RouteLine, SpawnPoint, build_ego, build_route_line
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    HardBrake,
    LaneMotion,
    PathMotion,
    StartMotion,
    TimeTrigger,
)

VAN = PROPS["parked-van"]
ROADSIDE_M = 3.05
"""From the lane's centre line to that of something at the kerb; cars pass it with 0.9 m to spare."""
KERB_M = 3.5
"""From the lane's centre line to where somebody waits to cross."""
ACROSS_M = 7.0
"""From the lane's centre line to the far kerb."""
EXIT_M, APPROACH_M = 6.0, 8.0
"""How far behind and before the junction things happen."""
STOPPED_M = 10.0
"""How far behind the junction somebody stands in the lane."""
HALF_BESIDE_M = 1.2
"""From the lane's centre line to that of a car half in it: one passes it without leaving the own lane by half."""
HIDES_M = 0.6
"""At least, between the van and whom it hides."""
CYCLE_MPS = 3.0
HALF_CAR_S = 0.35
"""In which a CAV drives half its length."""
LEAD_M = 11.0
CORNER_M = 7.0
"""How far ahead of a CAV's start the van stands that hides who comes from the right."""
BESIDE_M = 1.5
"""Least distance of a parked van from the centre line of any CAV's route."""
SHIFTS_M = np.array((0.0, -3.0, 3.0, -6.0, 6.0, -9.0))
HIDING_M = np.arange(3.75, 7.5, 0.25)
"""Where a van may stand: from where it belongs, and how far before whom it hides."""
HOLD_S = 3.0
PULL_OUT_M = 8.0
"""Length of the way from a parking place to the lane."""


class _CavRoute:
    """A CAV's way with the places of the drive on it, stations in metres."""

    def __init__(self, ego: Ego, roads: RoadMap) -> None:
        self.ego, self.roads = ego, roads
        self.way = next(
            w for w in (*find_lane_routes(roads), *find_lane_change_routes(roads)) if set(ego.lanes) <= set(w.lanes)
        )
        self.line: RouteLine = build_route_line(roads, self.way, 0.5)
        self.start = self.project(ego.start.x, ego.start.y)
        self.edge, self.exit = locate_junction(roads, self.way)

    def project(self, x: float, y: float) -> float:
        return float(shapely.line_locate_point(shapely.LineString(self.line.xy), shapely.Point(x, y)))

    def at(self, station: float, offset: float = 0.0) -> Pose:
        """Pose on the way, `offset` to its left."""
        line = shapely.LineString(self.line.xy)
        a, b = line.interpolate(station - 0.5), line.interpolate(station + 0.5)
        yaw, mid = math.atan2(b.y - a.y, b.x - a.x), line.interpolate(station)
        x, y = mid.x - offset * math.sin(yaw), mid.y + offset * math.cos(yaw)
        return Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4))

    def lanes_right(self, station: float) -> float:
        """Width [m] of the lanes between the CAV's lane and the kerb."""
        here = shapely.Point(self.line.xy[round(station)])
        lanes = [self.roads.lanes[id_] for id_ in self.way.lanes]
        lane = min(lanes, key=lambda lane: shapely.LineString(lane.centre.xy).distance(here))
        width = 0.0
        while lane.right:
            lane = self.roads.lanes[lane.right]
            width += lane.width
        return width

    def station(self, actor: ProposedActor) -> float:
        """Where an actor belongs: before the junction, in it, or behind it."""
        if actor.timing_phase == "on_approach":
            return max(self.edge - APPROACH_M, self.start + 6.0)
        return (self.edge + self.exit) / 2 if actor.timing_phase == "in_intersection" else self.exit + EXIT_M


def place_pre_crash_actors(
    proposed: Sequence[ProposedActor], egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Actors of the scenario; `egos` are by the proposal's vehicle ids. Raises InputError where one has no room.

    What the typologies' templates propose is staged here; anything else that a proposal names is placed as always.
    """
    drives = {name: _CavRoute(ego, roads) for name, ego in egos.items()}
    vans = [actor for actor in proposed if actor.kind == "parked_vehicle" and _alone(actor, "offroad_right")]
    movers = [actor for actor in proposed if _sets_off(actor)]
    made = {actor.actor_id: _moving(actor, drives[actor.affects_vehicle], egos) for actor in movers}
    for actor in vans:
        there = (actor.affects_vehicle, actor.timing_phase)
        hidden = [made[a.actor_id] for a in movers if (a.affects_vehicle, a.timing_phase) == there]
        made[actor.actor_id] = _van(actor, drives[actor.affects_vehicle], hidden[0] if hidden else None, egos)
    others = [actor for actor in proposed if actor.actor_id not in made]
    return (*made.values(), *place_actors(others, egos, roads, rng))


def _alone(actor: ProposedActor, *laterals: Lateral) -> bool:
    return actor.quantity == 1 and actor.lateral_position in laterals


def _sets_off(actor: ProposedActor) -> bool:
    """Whether it crosses, or is a car on the lane of a CAV that goes the same way."""
    if actor.kind == "npc_vehicle":
        known = _alone(actor, "center", "half_right", "left_edge", "offroad_right")
        return known and actor.direction_relative_to == "same"
    return actor.motion == "cross_perpendicular" and actor.quantity == 1


def _moving(actor: ProposedActor, drive: _CavRoute, egos: Mapping[str, Ego]) -> Actor:
    return _car(actor, drive, egos) if actor.kind == "npc_vehicle" else _crosser(actor, drive)


def _van(actor: ProposedActor, drive: _CavRoute, hidden: Actor | None, egos: Mapping[str, Ego]) -> Actor:
    """At the kerb, directly before whom it hides if there is somebody, else wherever there is room."""
    if hidden is not None:
        stations = drive.project(hidden.start.x, hidden.start.y) - HIDING_M
    else:
        corner = actor.timing_phase == "on_approach"
        stations = (drive.start + CORNER_M if corner else drive.station(actor)) + SHIFTS_M
    for station in stations.tolist():
        van = Actor(
            id=actor.actor_id,
            kind="vehicle",
            model="parked-van",
            length=VAN.length,
            width=VAN.width,
            start=drive.at(station, -ROADSIDE_M - drive.lanes_right(station)),
        )
        if hidden is not None and _box(van).distance(_box(hidden)) < HIDES_M:
            continue
        if _free(_box(van), drive.roads, egos):
            return van
    raise InputError(f"actor {actor.actor_id}: expected room for a van at the kerb, found none")


def _box(actor: Actor) -> shapely.Polygon:
    start = actor.start
    return shapely.Polygon(box_corners(start.x, start.y, start.yaw, actor.length, actor.width))


def _free(box: shapely.Polygon, roads: RoadMap, egos: Mapping[str, Ego]) -> bool:
    inside = any(box.intersects(building) for building in roads.building_shapes)
    return not inside and all(box.distance(shapely.LineString(ego.xy)) > BESIDE_M for ego in egos.values())


def _setting_off(actor: ProposedActor, drive: _CavRoute) -> float:
    """Station of somebody who is hidden: behind a junction there must be room for the van, too."""
    if actor.kind == "npc_vehicle":
        return drive.exit + VAN.length + CAR_SIZE[0] / 2 + HIDES_M
    return drive.station(actor) + (0.0 if actor.timing_phase == "on_approach" else HIDES_M)


def _crosser(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Crosses from the kerb, set off so that blind driving meets it."""
    walker = actor.kind == "walker"
    speed = WALK_MPS[actor.speed] if walker else CYCLE_MPS
    station = _setting_off(actor, drive)
    right, left = drive.at(station, -KERB_M - drive.lanes_right(station)), drive.at(station, ACROSS_M)
    start, end = (left, right) if actor.crossing_direction == "left" else (right, left)
    here = drive.at(station)
    out = math.hypot(start.x - here.x, start.y - here.y)
    yaw = math.atan2(end.y - start.y, end.x - start.x)
    size = WALKER_SIZE if walker else CYCLIST_SIZE
    return Actor(
        id=actor.actor_id,
        kind="pedestrian" if walker else "cyclist",
        model="adult" if walker else "bicycle",
        length=size[0],
        width=size[1],
        start=Pose(x=start.x, y=start.y, yaw=round(yaw, 4)),
        motion=PathMotion(points=((start.x, start.y), (end.x, end.y)), speed=speed),
        avoid_collision=walker,
        trigger=_when_near(drive, start, station, _crossing_s(out, speed, 1.5 if walker else 1.2)),
        action=StartMotion(),
    )


def _crossing_s(distance: float, speed: float, acceleration: float) -> float:
    """Time [s] from the kerb to the middle of the lane, and a bit: a car comes with its front first."""
    gaining = min(speed**2 / 2 / acceleration, distance)
    return math.sqrt(2 * gaining / acceleration) + (distance - gaining) / speed + HALF_CAR_S


def _when_near(drive: _CavRoute, place: Pose, station: float, needed_s: float) -> DistanceTrigger:
    """Fires when blind driving needs `needed_s` to the station."""
    due = compute_arrival_s(drive.line, drive.start, station) - needed_s
    stations = np.arange(drive.start, station, 0.5)
    at = next((s for s in stations if compute_arrival_s(drive.line, drive.start, s) >= due), station - 0.5)
    here = drive.at(float(at))
    away = math.hypot(here.x - place.x, here.y - place.y)
    return DistanceTrigger(vehicle=drive.ego.id, distance_m=round(min(max(away, 3.0), 50.0), 2))


def _car(actor: ProposedActor, drive: _CavRoute, egos: Mapping[str, Ego]) -> Actor:
    if actor.lateral_position == "left_edge":
        return _waiting_beside(actor, drive, egos)
    if actor.lateral_position == "half_right":
        return _made(actor, start=drive.at(drive.exit + STOPPED_M, -HALF_BESIDE_M))
    if actor.lateral_position != "center":
        return _pulling_out(actor, drive)
    return _leading(actor, drive)


def _made(actor: ProposedActor, **more: object) -> Actor:
    van = actor.actor_id.startswith("van")
    size = {"length": VAN.length, "width": VAN.width} if van else {"length": CAR_SIZE[0], "width": CAR_SIZE[1]}
    return Actor.model_validate(
        {"id": actor.actor_id, "kind": "vehicle", "model": "van" if van else "car", **size, **more}
    )


def _waiting_beside(actor: ProposedActor, drive: _CavRoute, egos: Mapping[str, Ego]) -> Actor:
    """Stands in the junction ahead of the next lane to the left, where one waits to turn left."""
    lane = drive.roads.lanes[drive.ego.lanes[0]]
    if not lane.left:
        raise InputError(f"actor {actor.actor_id}: expected a lane to the left of {lane.id}, found none")
    edge = drive.at(drive.edge, drive.roads.lanes[lane.left].width)
    for ahead in np.arange((drive.exit - drive.edge) / 2, -VAN.length, -1.0):
        x, y = edge.x + ahead * math.cos(edge.yaw), edge.y + ahead * math.sin(edge.yaw)
        van = _made(actor, start=Pose(x=round(x, 3), y=round(y, 3), yaw=edge.yaw))
        if _free(_box(van), drive.roads, egos):
            return van
    raise InputError(f"actor {actor.actor_id}: expected room to wait in the junction, found none")


def _along(roads: RoadMap, way: LaneRoute, start: float) -> Ego:
    """The drive from there to the end of the way, lanes and start."""
    return build_ego(roads, "car", way, SpawnPoint(start, len(build_route_line(roads, way, 0.5).xy) - 1 - RIM_M), 0.5)


def _leading(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Drives ahead on the CAV's way and, if erratic, brakes hard in the junction."""
    start = drive.start + LEAD_M
    ahead = _along(drive.roads, drive.way, start)
    if actor.speed != "erratic":
        return _made(actor, start=ahead.start, motion=LaneMotion(lanes=ahead.lanes, speed=DRIVE_MPS[actor.speed]))
    at_s = round(compute_arrival_s(drive.line, start, drive.exit - 4.0), 2)
    motion = LaneMotion(lanes=ahead.lanes, speed=6.0)
    action = HardBrake(hold_s=HOLD_S, pacing=False, least_driven_s=1.0, resume_speed=DRIVE_MPS["normal"])
    return _made(actor, start=ahead.start, motion=motion, trigger=TimeTrigger(at_s=at_s), action=action)


def _pulling_out(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Stands at the kerb and pulls out when a CAV is near, then drives on before it."""
    station = _setting_off(actor, drive)
    last = len(drive.line.xy) - 1 - RIM_M
    points = [drive.at(station, -ROADSIDE_M)]
    for s in np.arange(station + 1.0, last, 1.0):
        share = min((s - station) / PULL_OUT_M, 1.0)
        points.append(drive.at(float(s), -ROADSIDE_M * (1 - share**2 * (3 - 2 * share))))
    motion = PathMotion(points=tuple((p.x, p.y) for p in points), speed=DRIVE_MPS[actor.speed])
    trigger = _when_near(drive, points[0], station, 2.5)
    return _made(actor, start=points[0], motion=motion, trigger=trigger, action=StartMotion())
