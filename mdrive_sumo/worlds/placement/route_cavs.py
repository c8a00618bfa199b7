"""CAVs on lane routes, whether these meet or not: starts and goals."""

import random
from itertools import combinations

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.worlds.lane_routes import locate_junction
from mdrive_sumo.worlds.placement.cavs import NoRoomError, SpawnPoint, build_spawned_cav
from mdrive_sumo.worlds.placement.lane_chains import (
    RouteLines,
    build_way_line,
    find_conflict_stations,
)
from mdrive_sumo.worlds.placement.spawn_points import (
    RIM_M,
    RUN_OUT_M,
    LaneRoutes,
    choose_spawn_points,
    draw_start_behind,
)
from mdrive_sumo.worlds.placement.spawn_points import RUN_UP_M as CONFLICT_RUN_UP_M

CHANGE_SHARES = (0.3, 0.4, 0.5, 0.6)
"""Where on its lane a lane change begins; few values, for lines of routes are cached."""
RUN_UP_M = (8.0, 60.0)
"""[m] From the start of a single CAV to its junction."""
AT_JUNCTION_SHARE = 0.7
"""Share of single CAVs that start before a junction, if their route has one; the others start anywhere."""
LEAST_ROUTE_M = 35.0
"""[m] A junction and some run-up; chosen."""
MEET_M = (20.0, 60.0)
"""[m] From start to meeting point of CAVs that come towards each other on a road without a junction."""
BESIDE_M = (-9.0, 9.0)
"""[m] How far a CAV starts behind (-) or ahead of one in the next lane: two car lengths; chosen."""


def build_route_cavs(
    ways: LaneRoutes, route_m: tuple[float, float], roads: RoadMap, rng: random.Random, stretch: float = 1.0
) -> dict[str, Ego]:
    """Return the CAVs by vehicle id, at rest, with routes of a length drawn between two bounds [m].

    stretch: factor on these bounds and on the distances to where CAVs meet, for CAVs that are faster than 8 m/s. Raises
    NoRoomError where they have no room.
    """
    share = rng.choice(CHANGE_SHARES)
    lines = {name: build_way_line(roads, way, share) for name, way in ways.items()}
    spawns = _choose_spawns(ways, lines, stretch, rng.uniform(*route_m), roads, rng)
    return {
        name: build_spawned_cav(roads, str(number), way, spawns[name], share)
        for number, (name, way) in enumerate(ways.items())
    }


def _choose_spawns(
    ways: LaneRoutes, lines: RouteLines, stretch: float, drawn_m: float, roads: RoadMap, rng: random.Random
) -> dict[str, SpawnPoint]:
    route_m = stretch * drawn_m
    if len(ways) == 1:
        ((name, way),) = ways.items()
        begin, length = locate_junction(roads, way)[0], lines[name].last_m
        last = length - RIM_M - LEAST_ROUTE_M
        near = any(roads.lanes[lane].junction for lane in way.lanes) and rng.random() < AT_JUNCTION_SHARE
        start = begin - stretch * rng.uniform(*RUN_UP_M) if near else rng.uniform(RIM_M, max(last, RIM_M))
        start = min(max(start, RIM_M), last)
        return {name: SpawnPoint(start, min(start + route_m, length - RIM_M))}
    if any(find_conflict_stations(lines[a], lines[b]) for a, b in combinations(ways, 2)):
        nearest_m, farthest_m = CONFLICT_RUN_UP_M
        return choose_spawn_points(lines, ways, route_m, rng, (stretch * nearest_m, stretch * farthest_m))
    return _choose_passing_spawns(ways, lines, route_m, stretch, rng)


def _choose_passing_spawns(
    ways: LaneRoutes, lines: RouteLines, route_m: float, stretch: float, rng: random.Random
) -> dict[str, SpawnPoint]:
    """Return starts of CAVs whose routes never cross: behind, beside or towards the first one."""
    first, *others = ways
    lengths = {name: lines[name].last_m for name in ways}
    starts = {first: rng.uniform(RIM_M, max(lengths[first] - LEAST_ROUTE_M - RIM_M, RIM_M))}
    for name in others:
        if (behind := draw_start_behind(name, starts, ways, rng)) is not None:
            starts[name] = behind
            continue
        is_beside = ways[name].entry == ways[first].entry
        ahead = rng.uniform(*BESIDE_M) if is_beside else stretch * rng.uniform(*MEET_M)
        at = lines[first].xy[int(min(max(starts[first] + ahead, 0.0), lengths[first]))]
        met = lines[name].locate(*at.tolist())
        starts[name] = met if is_beside else met - stretch * rng.uniform(*MEET_M)
    for name, start in starts.items():
        if not RIM_M <= start <= lengths[name] - RIM_M - RUN_OUT_M:
            raise NoRoomError(f"{name}: expected room for its start on {lengths[name]} m, found {start:.0f} m")
    return {name: SpawnPoint(start, min(start + route_m, lengths[name] - RIM_M)) for name, start in starts.items()}
