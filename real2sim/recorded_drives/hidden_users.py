"""Road users that cross the route of a CAV in a recording, what hides them, and the units that see them early."""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.actors.kinematic_limits import LIMITS_BY_KIND
from mdrive_sumo.agents.sensorless import CONSTANT_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.reference_path import SPACING_M, build_path, compute_curve_speeds
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor, TimeTrigger
from mdrive_sumo.scenario.start_boxes import CAR, build_user_box
from mdrive_sumo.worlds.encounters.crossing_users import find_road_edge
from mdrive_sumo.worlds.placement.blind_driving import BLIND_ACCELERATION, BLIND_SPEED
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_crossing_actor
from mdrive_sumo.worlds.placement.lane_chains import Spot, build_pose, compute_route_pose

STATION_M = (24.0, 50.0)
"""[m] Along the route: later than a CAV that brakes needs from the start, and earlier than a recording of 46 m ends."""
HIDDEN_SHARE = 0.95
"""Share of those who come out from behind something."""
LEFT_SHARE = 0.15
"""Share of those who come from the left."""
CYCLIST_SHARE = 0.3
WALK_MPS, CYCLE_MPS = (1.5, 2.8), (2.5, 4.5)
"""[m/s] From walking to running; cyclists who come off a pavement."""
SEEN_S = (0.0, 0.6)
"""[s] How long before blind driving gets there they come out from behind what hides them: `single` needs 0.8 s or more
to brake so hard that it hits none (scenarios of a trial draw). Longer where the route is far from the edge."""
EARLY_S = (-0.8, 0.5)
"""[s] How long before blind driving gets there they are in the middle of its lane: with less or more none is hit."""
MOVES_S = (2.0, 2.6)
"""[s] How long before blind driving gets there they set off: a driver who sees that stops from 8 m/s in 2 s, at the
planners' 4 m/s2. One that is told of it late, or sees the road user come out from behind something, does not."""
BEHIND_M = (0.8, 5.5)
"""[m] From the edge of the road to where they set off: a van of 2 m hides them from those who are 20 m away."""
HIDES_M = (0.3, 0.7)
"""[m] Between what hides a road user and its way."""
SCREENS = ("parked-van", "parked-van", "parked-truck", "parked-car")
KERB_M = 0.8
"""[m] Beyond the edge of the road they arrive."""
UNIT_AHEAD_M, UNIT_KERB_M = (4.0, 14.0), 2.0
"""[m] A unit stands behind the kerb from which a road user comes, so far ahead along the route."""
LEAST_START_MPS = 1.0
"""[m/s] A slower CAV counts as one of this speed: the time of the first metre is finite."""
TRIES = 150
"""Draws of a crossing before a route goes without; chosen."""
SECOND_SHARE = 0.6
"""Share of CAVs whose route two road users cross."""
APART_M = 10.0
"""[m] Between two on one route: a CAV that has stopped for the first is at speed again."""
LEAST_START_S = 1.05
"""[s] They wait until the recording begins, after 1 s: where the CAVs are by then does not depend on them."""


@dataclass(frozen=True, slots=True)
class RouteCrossing:
    """A road user that crosses a CAV's route."""

    actors: tuple[Actor, ...]
    """What hides it, if anything, and itself."""
    station: float
    """[m] Where its way meets the route."""
    moves_s: float
    """[s] How long before blind driving gets there it sets off."""
    unit: RoadsideUnit


def draw_crossings(
    roads: RoadMap, egos: Sequence[Ego], start_mps: float, rng: random.Random
) -> Iterator[tuple[Ego, RouteCrossing]]:
    """Yield one or two road users for every CAV whose route has room for them. `start_mps` [m/s]: of the CAVs."""
    for ego in egos:
        times = compute_blind_times(ego, start_mps)
        stations: list[float] = []
        for number in range(1 + (rng.random() < SECOND_SHARE)):
            for _ in range(TRIES):
                crossing = _draw_crossing(roads, ego, times, f"{ego.id}{number}", rng)
                if crossing is not None and all(abs(crossing.station - s) > APART_M for s in stations):
                    stations.append(crossing.station)
                    yield ego, crossing
                    break


def compute_blind_times(ego: Ego, start_mps: float, start_m: float = 0.0) -> Float:
    """Return the time [s] at which blind driving is at each metre of a CAV's route (N,), from `start_m` [m] at
    `start_mps` [m/s] on."""
    path = build_path(ego.xy, CAR.rear_to_centre)
    speeds = compute_curve_speeds(path, BLIND_SPEED, CONSTANT_SPEED.lateral_acceleration, CONSTANT_SPEED.braking)
    metres = np.arange(len(ego.xy), dtype=np.float64)
    bends = np.interp(np.linspace(0.0, path.goal_s, len(metres)), np.arange(len(speeds)) * SPACING_M, speeds)
    driven = np.maximum(metres - start_m, 0.0)
    rising = np.sqrt(start_mps * start_mps + 2 * BLIND_ACCELERATION * driven)
    return np.concatenate(([0.0], np.cumsum(np.diff(driven) / np.minimum(rising, bends)[1:])))


def time_crossing(ego: Ego, crossing: RouteCrossing, start: tuple[float, float, float]) -> Actor:
    """Return the road user that sets off in time to meet blind driving, of which `start` is a time [s], the station
    [m] and the speed [m/s] then."""
    start_s, start_m, start_mps = start
    times = compute_blind_times(ego, max(start_mps, LEAST_START_MPS), start_m)
    met_s = start_s + float(np.interp(crossing.station, np.arange(len(times)), times))
    return crossing.actors[-1].model_copy(update={"trigger": TimeTrigger(at_s=round(met_s - crossing.moves_s, 2))})


def _draw_crossing(roads: RoadMap, ego: Ego, times: Float, name: str, rng: random.Random) -> RouteCrossing | None:
    station = rng.uniform(*STATION_M)
    side = 1.0 if rng.random() < LEFT_SHARE else -1.0
    near, far = (find_road_edge(roads, ego, round(station), sign) for sign in (side, -side))
    if near is None or far is None or _is_in_junction(roads, ego, station):
        return None
    body, speeds = (BODIES["bicycle"], CYCLE_MPS) if rng.random() < CYCLIST_SHARE else (BODIES["adult"], WALK_MPS)
    speed = round(rng.uniform(*speeds), 2)
    moves_s, early_s = rng.uniform(*MOVES_S), max(rng.uniform(*SEEN_S) - near / speed, EARLY_S[0])
    behind = _compute_progress(speed, LIMITS_BY_KIND[Kind[body.kind.upper()]].accel, moves_s - early_s) - near
    start_s = float(np.interp(station, np.arange(len(times)), times)) - moves_s
    if early_s > EARLY_S[1] or not BEHIND_M[0] <= behind <= BEHIND_M[1] or start_s < LEAST_START_S:
        return None
    offsets = (side * (near + behind), -side * (far + KERB_M))
    begin, end = (compute_route_pose(ego, station, offset)[:2] for offset in offsets)
    is_hidden = rng.random() < HIDDEN_SHARE
    screen = (_build_screen(ego, f"screen_{name}", (station, side * near), rng),) if is_hidden else ()
    user = build_crossing_actor(f"{body.kind}_{name}", body, (begin, end), speed, TimeTrigger(at_s=round(start_s, 2)))
    needed = (shapely.LineString((begin, end)), *map(build_user_box, screen))
    if any(building.intersects(one) for building in roads.building_shapes for one in needed):
        return None
    ahead_m = rng.uniform(*UNIT_AHEAD_M)
    unit = _place_unit(roads, ego, f"post{name}", (station + ahead_m, side * (near + UNIT_KERB_M)))
    return RouteCrossing((*screen, user), station, moves_s, unit)


def _compute_progress(speed: float, acceleration: float, after_s: float) -> float:
    """Return how far [m] a road user gets from rest that accelerates [m/s2] to a speed [m/s]."""
    rising_s = min(speed / acceleration, after_s)
    return acceleration * rising_s * rising_s / 2 + speed * (after_s - rising_s)


def _is_in_junction(roads: RoadMap, ego: Ego, station: float) -> bool:
    k = min(round(station), len(ego.route) - 1)
    return bool(roads.in_junction[roads.find_nearest_lanes(ego.xy[k][None]).lane[0]])


def _build_screen(ego: Ego, name: str, at: tuple[float, float], rng: random.Random) -> Actor:
    """Return a vehicle that stands at the edge of the road, directly before the station as the CAV comes."""
    (station, edge), body = at, BODIES[rng.choice(SCREENS)]
    back = station - rng.uniform(*HIDES_M) - BODIES["adult"].length / 2 - body.length / 2
    away = abs(edge) + rng.uniform(-0.1, 0.3) + body.width / 2
    pose = build_pose(*compute_route_pose(ego, back, away if edge > 0 else -away))
    return build_actor(name, body, pose)


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
