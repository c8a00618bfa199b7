"""Road users that cross the route of a CAV in a recording, what hides them, and the units that see them early."""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.crossing_users import find_road_edge
from mdrive_sumo.worlds.placement.blind_driving import BLIND_SPEED
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_arrival_trigger, build_crossing_actor
from mdrive_sumo.worlds.placement.lane_chains import Spot, build_pose, compute_route_pose

STATION_M = (13.0, 43.0)
"""[m] Along the route: later than the CAV can be at speed, and earlier than a recording of 46 m ends."""
HIDDEN_SHARE = 0.75
"""Share of those who come out from behind something."""
LEFT_SHARE = 0.25
"""Share of those who come from the left."""
CYCLIST_SHARE = 0.3
WALK_MPS, CYCLE_MPS = (1.2, 2.6), (2.5, 4.5)
"""[m/s] From walking to running; cyclists who come off a pavement."""
EARLY_S = (-0.3, 1.2)
"""[s] How long before blind driving gets there they are in the middle of its lane: with less or more nobody is hit."""
HIDES_M = (0.6, 1.4)
"""[m] Between what hides a road user and its way."""
SCREENS = ("parked-van", "parked-van", "parked-car", "parked-truck")
KERB_M = 0.8
"""[m] Beyond the edge of the road they wait, and arrive."""
UNIT_AHEAD_M, UNIT_KERB_M = (4.0, 14.0), 2.0
"""[m] A unit stands behind the kerb at which somebody waits, so far ahead along the route."""
TRIGGER_RADIUS_M = 3.0
"""[m] Of `build_arrival_trigger`: it fires so much earlier."""
TRIES = 20


@dataclass(frozen=True, slots=True)
class RouteCrossing:
    """A road user that crosses a CAV's route."""

    actors: tuple[Actor, ...]
    """What hides it, if anything, and itself."""
    station: float
    """[m] Where its way meets the route."""
    unit: RoadsideUnit


def draw_crossings(roads: RoadMap, egos: Sequence[Ego], rng: random.Random) -> Iterator[tuple[Ego, RouteCrossing]]:
    """Yield a road user for every CAV whose route has room for one."""
    for ego in egos:
        for _ in range(TRIES):
            if (crossing := _draw_crossing(roads, ego, rng)) is not None:
                yield ego, crossing
                break


def _draw_crossing(roads: RoadMap, ego: Ego, rng: random.Random) -> RouteCrossing | None:
    station = rng.uniform(*STATION_M)
    side = 1.0 if rng.random() < LEFT_SHARE else -1.0
    near, far = (find_road_edge(roads, ego, round(station), sign) for sign in (side, -side))
    if near is None or far is None or _is_in_junction(roads, ego, station):
        return None
    body, speeds = (BODIES["bicycle"], CYCLE_MPS) if rng.random() < CYCLIST_SHARE else (BODIES["adult"], WALK_MPS)
    speed = round(rng.uniform(*speeds), 2)
    offsets = (side * (near + KERB_M), -side * (far + KERB_M))
    begin, end = (compute_route_pose(ego, station, offset)[:2] for offset in offsets)
    is_hidden = rng.random() < HIDDEN_SHARE
    screen = (_build_screen(ego, station, side * near, rng),) if is_hidden else ()
    lead_m = BLIND_SPEED * ((near + KERB_M) / speed + rng.uniform(*EARLY_S))
    trigger = build_arrival_trigger(ego, max(station - lead_m + TRIGGER_RADIUS_M, 0.0))
    user = build_crossing_actor(f"{body.kind}_{ego.id}", body, (begin, end), speed, trigger)
    ahead_m = rng.uniform(*UNIT_AHEAD_M)
    unit = _place_unit(roads, ego, f"post{ego.id}", (station + ahead_m, side * (near + UNIT_KERB_M)))
    return RouteCrossing((*screen, user), station, unit)


def _is_in_junction(roads: RoadMap, ego: Ego, station: float) -> bool:
    k = min(round(station), len(ego.route) - 1)
    return bool(roads.in_junction[roads.find_nearest_lanes(ego.xy[k][None]).lane[0]])


def _build_screen(ego: Ego, station: float, edge: float, rng: random.Random) -> Actor:
    """Return a vehicle that stands at the edge of the road, directly before the station as the CAV comes."""
    body = BODIES[rng.choice(SCREENS)]
    back = station - rng.uniform(*HIDES_M) - BODIES["adult"].length / 2 - body.length / 2
    away = abs(edge) + rng.uniform(-0.1, 0.3) + body.width / 2
    pose = build_pose(*compute_route_pose(ego, back, away if edge > 0 else -away))
    return build_actor(f"screen_{ego.id}", body, pose)


def _place_unit(roads: RoadMap, ego: Ego, name: str, at: tuple[float, float]) -> RoadsideUnit:
    """Return a unit at a station and offset [m] of a route, nearer to the road if a building stands there."""
    station, offset = at
    x, y, _ = compute_route_pose(ego, station, offset)
    if any(building.intersects(shapely.Point(x, y)) for building in roads.building_shapes):
        x, y, _ = compute_route_pose(ego, station, offset - math.copysign(UNIT_KERB_M - KERB_M / 2, offset))
    return RoadsideUnit(id=name, x=round(x, 3), y=round(y, 3))


def place_second_unit(roads: RoadMap, ego: Ego, crossing: RouteCrossing) -> RoadsideUnit:
    """Return a unit at the opposite side of the road, before the crossing, for a recording of one CAV."""
    back: Spot = (crossing.station - UNIT_AHEAD_M[1], 0.0)
    side = 1.0 if _find_side(ego, crossing) < 0 else -1.0
    edge = find_road_edge(roads, ego, max(round(back[0]), 0), side) or STATION_M[0]
    return _place_unit(roads, ego, "post_opposite", (max(back[0], 0.0), side * (edge + UNIT_KERB_M)))


def _find_side(ego: Ego, crossing: RouteCrossing) -> float:
    """Return the cross product of the route and the way to the unit: negative on the right."""
    x, y, yaw = compute_route_pose(ego, crossing.station, 0.0)
    return portable.cos(yaw) * (crossing.unit.y - y) - portable.sin(yaw) * (crossing.unit.x - x)
