"""Spawn points: start and goal of each CAV on its route, such that blind driving brings the CAVs together.

Every CAV starts from rest and, driven blindly, reaches its conflict with another one at nearly the same time.
"""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.generate.lane_routes import LaneRoute
from mdrive_sumo.roads import RoadMap, build_lane_route
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose

BLIND_SPEED, BLIND_ACCELERATION = 8.0, 2.5
"""[m/s], [m/s2] Parameters of `constant-speed` (protocol 14.2)."""
RUN_UP_M = (14.0, 56.0)
"""[m] Distance from start to conflict of the first CAV; the original uses 28 m before a junction on average."""
LEAST_RUN_UP_M = 12.0
CORRIDOR_M = (45.0, 70.0)
"""[m] Start of CAVs on roads without a junction, with room for a queue behind and obstacles ahead."""
BESIDE_M = (-5.0, 5.0)
"""[m] Distance ahead of a CAV at which one in the next lane starts."""
DRAWS = 30
TOGETHER_S = 0.5
"""[s] CAVs that reach their conflict within this time meet there."""
APART_S = 0.5
"""[s] How much earlier or later than another one a CAV may reach their conflict."""
GAP_M = (7.0, 14.0)
"""[m] Distance between box centres in a queue, a car's length included."""
RUN_OUT_M = 14.0
"""[m] Least distance from a conflict to the goal."""
RIM_M = 4.0
"""[m] Least distance of starts and goals from the ends of a route."""
MEETING_M = 1.6
"""[m] Routes within this distance of each other conflict."""


@dataclass(frozen=True, slots=True, eq=False)
class RouteLine:
    """A lane route as a line: points every metre (N, 2) [m], and where it begins on its first lane [m]."""

    xy: Float
    start_s: float


@lru_cache(maxsize=4096)
def build_route_line(roads: RoadMap, way: LaneRoute, change_share: float) -> RouteLine:
    """Return the line of the whole route; a lane change begins at that share of the lane that it leaves."""
    goal_s = roads.lanes[way.lanes[-1]].centre.length
    route = build_lane_route(roads, way.lanes, 0.0, goal_s, _lane_change_stations(roads, way, change_share))
    return RouteLine(route.xy, 0.0)


def _lane_change_stations(roads: RoadMap, way: LaneRoute, share: float) -> dict[int, float]:
    if way.change_index < 0:
        return {}
    return {way.change_index: share * roads.lanes[way.lanes[way.change_index]].centre.length}


@lru_cache(maxsize=4096)
def find_conflict_stations(one: RouteLine, other: RouteLine) -> tuple[float, float] | None:
    """Return the stations [m] at which two routes first come together after having been apart; None if they never
    do."""
    near = np.asarray(shapely.distance(shapely.points(one.xy), shapely.LineString(other.xy)) < MEETING_M)
    if near[0]:
        return None  # they begin together: a queue
    if not near.any():
        return None
    i = int(np.argmax(near))
    return float(i), float(shapely.line_locate_point(shapely.LineString(other.xy), shapely.Point(one.xy[i])))


def blind_travel_time(distance: float) -> float:
    """Return the time [s] in which blind driving covers a distance [m] from rest."""
    speeding = (BLIND_SPEED * BLIND_SPEED) / 2 / BLIND_ACCELERATION
    if distance < speeding:
        return math.sqrt(2 * max(distance, 0.0) / BLIND_ACCELERATION)
    return BLIND_SPEED / BLIND_ACCELERATION + (distance - speeding) / BLIND_SPEED


def blind_distance(time: float) -> float:
    """Return the distance [m] that blind driving covers in a time [s] from rest."""
    speeding = BLIND_SPEED / BLIND_ACCELERATION
    if time < speeding:
        return BLIND_ACCELERATION * portable.square(max(time, 0.0)) / 2
    return BLIND_SPEED * (time - speeding / 2)


@dataclass(frozen=True, slots=True)
class SpawnPoint:
    """Stations [m] of start and goal on a line."""

    start: float
    goal: float


RouteLines = Mapping[str, RouteLine]
LaneRoutes = Mapping[str, LaneRoute]
StartStations = dict[str, float]
"""Station of the start [m] by vehicle id."""


def choose_spawn_points(
    lines: RouteLines, ways: LaneRoutes, route_m: float, rng: random.Random
) -> dict[str, SpawnPoint] | str:
    """Return start and goal of every CAV, with routes about `route_m` long; or the reason why there is no room.

    Of several random draws the one in which most pairs of CAVs meet.
    """
    draws = [_draw_starts(lines, ways, rng) for _ in range(DRAWS)]
    found = [draw for draw in draws if not isinstance(draw, str)]
    if not found:
        return next(draw for draw in draws if isinstance(draw, str))
    starts = max(found, key=lambda draw: _count_encounters(draw, lines))
    last = {name: max((met[0] for _, met in _find_conflicts(name, lines)), default=0.0) for name in starts}
    rims = {name: len(lines[name].xy) - 1 - RIM_M for name in starts}
    goals = {
        name: min(max(start + route_m * rng.uniform(0.9, 1.1), last[name] + RUN_OUT_M), rims[name])
        for name, start in starts.items()
    }
    return {name: SpawnPoint(start, goals[name]) for name, start in starts.items()}


def _draw_starts(lines: RouteLines, ways: LaneRoutes, rng: random.Random) -> StartStations | str:
    starts: StartStations = {}
    for name in ways:
        start, length = _draw_start(name, starts, lines, ways, rng), len(lines[name].xy) - 1
        if not RIM_M <= start <= length - RIM_M - RUN_OUT_M:
            return f"{name}: expected room for its start on its way of {length:.0f} m, found {start:.0f} m"
        starts[name] = start
    return starts


def _find_conflicts(name: str, lines: RouteLines) -> Iterator[tuple[str, tuple[float, float]]]:
    for other in lines:
        if other != name and (met := find_conflict_stations(lines[name], lines[other])) is not None:
            yield other, met


def _count_encounters(starts: StartStations, lines: RouteLines) -> int:
    """Count the pairs of CAVs that blind driving brings together."""
    return sum(
        min(met[0] - starts[name], met[1] - starts[other]) > 0
        and abs(blind_travel_time(met[0] - starts[name]) - blind_travel_time(met[1] - starts[other])) < TOGETHER_S
        for name in starts
        for other, met in _find_conflicts(name, lines)
    )


def _draw_start(name: str, starts: StartStations, lines: RouteLines, ways: LaneRoutes, rng: random.Random) -> float:
    """Return a start behind the CAVs on the same lane, beside those on the same road, or such that it meets another
    CAV."""
    ahead = [starts[other] for other in starts if ways[other].lanes[0] == ways[name].lanes[0]]
    if ahead:
        return min(ahead) - rng.uniform(*GAP_M)
    beside = [starts[other] for other in starts if ways[other].entry == ways[name].entry]
    if beside:
        return beside[0] + rng.uniform(*BESIDE_M)
    met = dict(_find_conflicts(name, lines))
    if not met:
        return rng.uniform(*CORRIDOR_M)
    first = min(found[0] for found in met.values())
    for other, start in starts.items():
        if other in met and met[other][1] > start:
            time = blind_travel_time(met[other][1] - start) + rng.uniform(-APART_S, APART_S)
            found = met[other][0] - blind_distance(time)
            if RIM_M <= found <= first - LEAST_RUN_UP_M:
                return found
    return max(first - rng.uniform(*RUN_UP_M), RIM_M)


def build_ego(roads: RoadMap, name: str, way: LaneRoute, spawn: SpawnPoint, change_share: float) -> Ego:
    """Return the CAV that drives a route from start to goal, at rest on the first point of its dense route."""
    lanes, start_s, goal_s, dropped = _trim_lanes(roads, way, spawn)
    changes = {i - dropped: s for i, s in _lane_change_stations(roads, way, change_share).items() if i >= dropped}
    route = build_lane_route(roads, lanes, start_s, goal_s, changes)
    xy, yaws = route.xy.tolist(), route.yaw.tolist()
    points = tuple((round(x, 3), round(y, 3), round(yaw, 4)) for (x, y), yaw in zip(xy, yaws, strict=True))
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), lanes=route.lanes, route=points)


def _trim_lanes(roads: RoadMap, way: LaneRoute, spawn: SpawnPoint) -> tuple[Sequence[str], float, float, int]:
    """Return the lanes between start and goal, arc lengths on the first and the last, and the number of lanes removed
    in front."""
    begins = [0.0]
    for i, id_ in enumerate(way.lanes[:-1]):
        begins.append(begins[-1] + (0.0 if i == way.change_index else roads.lanes[id_].centre.length))
    ends = [begin + roads.lanes[id_].centre.length for begin, id_ in zip(begins, way.lanes, strict=True)]
    first = next(i for i, end in enumerate(ends) if spawn.start < end - 1.0)
    last = next(i for i, end in enumerate(ends) if spawn.goal <= end + 1.0 and i >= first and i != way.change_index)
    length = roads.lanes[way.lanes[last]].centre.length
    goal_s = min(spawn.goal - begins[last], length)
    return way.lanes[first : last + 1], spawn.start - begins[first], goal_s, first
