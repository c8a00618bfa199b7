"""Places the actors of pre-crash scenarios: crossing, leading, pulling out or not yielding, and the vehicles that hide
them."""

import math
import random
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap
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
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.worlds.encounters.crossing_users import CYCLING_MPS, WALKING_MPS
from mdrive_sumo.worlds.encounters.proposed_actor import Lateral, ProposedActor
from mdrive_sumo.worlds.encounters.route_actors import (
    DRIVE_MPS,
    WALKER,
    place_actors,
)
from mdrive_sumo.worlds.lane_routes import find_lane_change_routes, find_lane_routes, locate_junction
from mdrive_sumo.worlds.placement.blind_driving import compute_arrival_s
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_crossing_actor, build_distance_trigger
from mdrive_sumo.worlds.placement.cavs import SpawnPoint, build_spawned_cav
from mdrive_sumo.worlds.placement.lane_chains import build_pose, build_way_line
from mdrive_sumo.worlds.placement.occupancy import overlaps_building
from mdrive_sumo.worlds.placement.spawn_points import RIM_M

VAN, CAR = BODIES["parked-van"], BODIES["car"]
ROADSIDE_M = 3.05
"""[m] Lateral distance from the lane's centre line to a vehicle at the kerb; cars pass it with 0.9 m clearance."""
KERB_M = 3.5
"""[m] Lateral distance from the lane's centre line to an actor that waits to cross."""
ACROSS_M = 7.0
"""[m] Lateral distance from the lane's centre line to the far kerb."""
EXIT_M, APPROACH_M = 6.0, 8.0
"""[m] Distance of events behind and before the junction."""
STOPPED_M = 10.0
"""[m] Distance behind the junction of a vehicle stopped in the lane."""
HALF_BESIDE_M = 1.2
"""[m] Lateral offset of a car half in the lane: it can be passed without leaving the own lane by half."""
HIDES_M = 0.6
"""[m] Least distance between the van and the actor that it hides."""
HALF_CAR_S = 0.35
"""[s] Time in which a CAV covers half its length."""
LEAD_M = 11.0
"""[m] From a CAV's start to that of a car ahead of it; chosen."""
CORNER_M = 7.0
"""[m] Distance ahead of a CAV's start of the van that hides traffic from the right."""
BESIDE_M = 1.5
"""[m] Least distance of a parked van from the centre line of any CAV's route."""
SHIFTS_M = np.array((0.0, -3.0, 3.0, -6.0, 6.0, -9.0))
"""[m] Offsets of a van from its nominal station that are tried, in this order."""
HIDING_M = np.arange(3.75, 7.5, 0.25)
"""[m] Candidate positions of a van: offsets from its nominal station, and distances before the actor that it hides."""
HOLD_S = 3.0
"""[s] A car that brakes hard then stands; chosen."""
PULL_OUT_M = 8.0
"""[m] Length of the path from a parking place to the lane."""


class _CavRoute:
    """The route of a CAV with the stations of its drive [m]."""

    def __init__(self, ego: Ego, roads: RoadMap) -> None:
        self.ego, self.roads = ego, roads
        self.way = next(
            w for w in (*find_lane_routes(roads), *find_lane_change_routes(roads)) if set(ego.lanes) <= set(w.lanes)
        )
        self.line = build_way_line(roads, self.way, 0.5)
        self.start = self.line.locate(ego.start.x, ego.start.y)
        self.edge, self.exit = locate_junction(roads, self.way)

    def at(self, station: float, offset: float = 0.0) -> Pose:
        """Return the pose on the route, `offset` to its left."""
        line = shapely.LineString(self.line.xy)
        a, b = line.interpolate(station - 0.5), line.interpolate(station + 0.5)
        mid = line.interpolate(station)
        return build_pose(mid.x, mid.y, portable.atan2(b.y - a.y, b.x - a.x), offset)

    def lanes_right(self, station: float) -> float:
        """Return the width [m] of the lanes between the CAV's lane and the kerb."""
        here = shapely.Point(self.line.xy[round(station)])
        lanes = [self.roads.lanes[id_] for id_ in self.way.lanes]
        lane = min(lanes, key=lambda lane: shapely.LineString(lane.centre.xy).distance(here))
        width = 0.0
        while lane.right:
            lane = self.roads.lanes[lane.right]
            width += lane.width
        return width

    def station(self, actor: ProposedActor) -> float:
        """Return the station of an actor: before the junction, in it, or behind it."""
        if actor.timing_phase == "on_approach":
            return max(self.edge - APPROACH_M, self.start + 6.0)
        return (self.edge + self.exit) / 2 if actor.timing_phase == "in_intersection" else self.exit + EXIT_M


def place_pre_crash_actors(
    proposed: Sequence[ProposedActor], egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Return the actors of the scenario; `egos` are by the proposal's vehicle ids. Raises InputError where one has no
    room.

    Actors of the typologies' templates are placed here; any other actor of a proposal is placed by `place_actors`.
    """
    drives = {name: _CavRoute(ego, roads) for name, ego in egos.items()}
    vans = [actor for actor in proposed if actor.kind == "parked_vehicle" and _is_single_at(actor, "offroad_right")]
    movers = [actor for actor in proposed if _is_mover(actor)]
    made = {actor.actor_id: _build_mover(actor, drives[actor.affects_vehicle], egos) for actor in movers}
    for actor in vans:
        hidden = [made[mover.actor_id] for mover in movers if mover.place == actor.place]
        made[actor.actor_id] = _build_van(actor, drives[actor.affects_vehicle], hidden[0] if hidden else None, egos)
    others = [actor for actor in proposed if actor.actor_id not in made]
    return (*made.values(), *place_actors(others, egos, roads, rng))


def _is_single_at(actor: ProposedActor, *laterals: Lateral) -> bool:
    return actor.quantity == 1 and actor.lateral_position in laterals


def _is_mover(actor: ProposedActor) -> bool:
    """Return whether the actor crosses, or is a car on the lane of a CAV in the same direction."""
    if actor.kind == "npc_vehicle":
        known = _is_single_at(actor, "center", "half_right", "left_edge", "offroad_right")
        return known and actor.direction_relative_to == "same"
    return actor.motion == "cross_perpendicular" and actor.quantity == 1


def _build_van(actor: ProposedActor, drive: _CavRoute, hidden: Actor | None, egos: Mapping[str, Ego]) -> Actor:
    """Return a van at the kerb, directly before the actor that it hides, else wherever there is room."""
    if hidden is not None:
        stations = drive.line.locate(hidden.start.x, hidden.start.y) - HIDING_M
    else:
        corner = actor.timing_phase == "on_approach"
        stations = (drive.start + CORNER_M if corner else drive.station(actor)) + SHIFTS_M
    for station in stations.tolist():
        van = build_actor(actor.actor_id, VAN, drive.at(station, -ROADSIDE_M - drive.lanes_right(station)))
        if hidden is not None and build_user_box(van).distance(build_user_box(hidden)) < HIDES_M:
            continue
        if _is_free(build_user_box(van), drive.roads, egos):
            return van
    raise InputError(f"actor {actor.actor_id}: expected room for a van at the kerb, found none")


def _is_free(box: shapely.Polygon, roads: RoadMap, egos: Mapping[str, Ego]) -> bool:
    return not overlaps_building(box, roads) and all(
        box.distance(shapely.LineString(ego.xy)) > BESIDE_M for ego in egos.values()
    )


def _start_station(actor: ProposedActor, drive: _CavRoute) -> float:
    """Return the station of a hidden actor: behind a junction there must be room for the van, too."""
    if actor.kind == "npc_vehicle":
        return drive.exit + VAN.length + CAR.length / 2 + HIDES_M
    return drive.station(actor) + (0.0 if actor.timing_phase == "on_approach" else HIDES_M)


def _build_crosser(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Return an actor that crosses from the kerb, triggered such that a blindly driven CAV meets it."""
    walker = actor.kind == "walker"
    speed = WALKING_MPS[actor.speed] if walker else CYCLING_MPS
    station = _start_station(actor, drive)
    right, left = drive.at(station, -KERB_M - drive.lanes_right(station)), drive.at(station, ACROSS_M)
    start, end = (left, right) if actor.crossing_direction == "left" else (right, left)
    here = drive.at(station)
    out = portable.hypot(start.x - here.x, start.y - here.y)
    trigger = _build_trigger(drive, start, station, _compute_crossing_s(out, speed, 1.5 if walker else 1.2))
    ends = ((start.x, start.y), (end.x, end.y))
    body = WALKER if walker else BODIES["bicycle"]
    return build_crossing_actor(actor.actor_id, body, ends, speed, trigger, avoid_collision=walker)


def _compute_crossing_s(distance: float, speed: float, acceleration: float) -> float:
    """Return the time [s] from the kerb to the middle of the lane, plus the time of half a car's length."""
    gaining = min((speed * speed) / 2 / acceleration, distance)
    return math.sqrt(2 * gaining / acceleration) + (distance - gaining) / speed + HALF_CAR_S


def _build_trigger(drive: _CavRoute, place: Pose, station: float, needed_s: float) -> DistanceTrigger:
    """Return a trigger that fires when blind driving needs `needed_s` to the station."""
    due = compute_arrival_s(drive.line, drive.start, station) - needed_s
    stations = np.arange(drive.start, station, 0.5)
    at = next((s for s in stations if compute_arrival_s(drive.line, drive.start, s) >= due), station - 0.5)
    here = drive.at(float(at))
    return build_distance_trigger(drive.ego, portable.hypot(here.x - place.x, here.y - place.y))


def _build_mover(actor: ProposedActor, drive: _CavRoute, egos: Mapping[str, Ego]) -> Actor:
    if actor.kind != "npc_vehicle":
        return _build_crosser(actor, drive)
    if actor.lateral_position == "left_edge":
        return _build_waiting_vehicle(actor, drive, egos)
    if actor.lateral_position == "half_right":
        return _build_vehicle(actor, drive.at(drive.exit + STOPPED_M, -HALF_BESIDE_M))
    if actor.lateral_position != "center":
        return _build_pulling_out_vehicle(actor, drive)
    return _build_leading_vehicle(actor, drive)


def _build_vehicle(actor: ProposedActor, start: Pose, **more: object) -> Actor:
    return build_actor(actor.actor_id, BODIES["van" if actor.actor_id.startswith("van") else "car"], start, **more)


def _build_waiting_vehicle(actor: ProposedActor, drive: _CavRoute, egos: Mapping[str, Ego]) -> Actor:
    """Return a vehicle that waits in the junction ahead of the next lane to the left, to turn left."""
    lane = drive.roads.lanes[drive.ego.lanes[0]]
    if not lane.left:
        raise InputError(f"actor {actor.actor_id}: expected a lane to the left of {lane.id}, found none")
    edge = drive.at(drive.edge, drive.roads.lanes[lane.left].width)
    for ahead in np.arange((drive.exit - drive.edge) / 2, -VAN.length, -1.0):
        x, y = edge.x + ahead * portable.cos(edge.yaw), edge.y + ahead * portable.sin(edge.yaw)
        van = _build_vehicle(actor, Pose(x=round(x, 3), y=round(y, 3), yaw=edge.yaw))
        if _is_free(build_user_box(van), drive.roads, egos):
            return van
    raise InputError(f"actor {actor.actor_id}: expected room to wait in the junction, found none")


def _build_leading_vehicle(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Return a vehicle ahead on the CAV's route that, if erratic, brakes hard in the junction."""
    start = drive.start + LEAD_M
    ahead = build_spawned_cav(drive.roads, "car", drive.way, SpawnPoint(start, drive.line.last_m - RIM_M), 0.5)
    if actor.speed != "erratic":
        return _build_vehicle(actor, ahead.start, motion=LaneMotion(lanes=ahead.lanes, speed=DRIVE_MPS[actor.speed]))
    at_s = round(compute_arrival_s(drive.line, start, drive.exit - 4.0), 2)
    motion = LaneMotion(lanes=ahead.lanes, speed=6.0)
    action = HardBrake(hold_s=HOLD_S, pacing=False, least_driven_s=1.0, resume_speed=DRIVE_MPS["normal"])
    return _build_vehicle(actor, ahead.start, motion=motion, trigger=TimeTrigger(at_s=at_s), action=action)


def _build_pulling_out_vehicle(actor: ProposedActor, drive: _CavRoute) -> Actor:
    """Return a vehicle that stands at the kerb and pulls out ahead of an approaching CAV."""
    station = _start_station(actor, drive)
    last = drive.line.last_m - RIM_M
    points = [drive.at(station, -ROADSIDE_M)]
    for s in np.arange(station + 1.0, last, 1.0):
        share = min((s - station) / PULL_OUT_M, 1.0)
        points.append(drive.at(float(s), -ROADSIDE_M * (1 - (share * share) * (3 - 2 * share))))
    motion = PathMotion(points=tuple((p.x, p.y) for p in points), speed=DRIVE_MPS[actor.speed])
    trigger = _build_trigger(drive, points[0], station, 2.5)
    return _build_vehicle(actor, points[0], motion=motion, trigger=trigger, action=StartMotion())
