"""Spawn points of the CAVs of a pre-crash scenario: close to the junction, so that they meet in it soon and unseen."""

import random
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from mdrive_sumo.agents.sensorless import CONSTANT_SPEED
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.loop import VEHICLE
from mdrive_sumo.planning.reference_path import SPACING_M, build_path, compute_curve_speeds
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.lane_routes import locate_junction
from mdrive_sumo.worlds.placement.cavs import SpawnPoint
from mdrive_sumo.worlds.placement.lane_chains import RouteLine, RouteLines, find_conflict_stations
from mdrive_sumo.worlds.placement.spawn_points import (
    BLIND_ACCELERATION,
    BLIND_SPEED,
    GAP_M,
    RIM_M,
    RUN_OUT_M,
    LaneRoutes,
    StartStations,
)

RUN_UP_M = (8.0, 13.0)
"""[m] From the start of the first CAV to the edge of the junction."""
WITNESS_M = (17.0, 24.0)
"""[m] The same for a CAV without a conflict, which observes what happens to the first one."""
PAST_M, EVENT_PAST_M = 4.0, 15.0
"""[m] Least distance from the junction to the goal, and where an event happens behind the junction."""
ROUTE_SHARE = 0.85
"""Share of the mean route length; conflicts lengthen many routes."""
START_BEFORE_JUNCTION_M = (6.0, 26.0)
"""[m] Distance from the junction of starts that are chosen to meet another CAV."""
APART_S = 0.25
"""[s] How much earlier or later than another one a CAV may reach their conflict."""
STEP_M = 0.5


def choose_pre_crash_spawn_points(
    proposal: Proposal, lines: RouteLines, ways: LaneRoutes, roads: RoadMap, route_m: float, rng: random.Random
) -> dict[str, SpawnPoint] | str:
    """Return start and goal of every CAV, or the reason why there is no room."""
    behind = {actor.affects_vehicle for actor in proposal.actors if actor.timing_phase in ("after_exit", "after_turn")}
    starts: StartStations = {}
    for name, way in ways.items():
        starts[name] = _draw_start(name, starts, lines, ways, locate_junction(roads, way)[0], rng)
        if starts[name] < RIM_M:
            return f"{name}: expected room for its start before the junction, found {starts[name]:.0f} m"
    spawned: dict[str, SpawnPoint] = {}
    for name, start in starts.items():
        past = EVENT_PAST_M if name in behind else PAST_M
        least = max(_last_conflict(name, start, lines) + RUN_OUT_M, locate_junction(roads, ways[name])[1] + past)
        rim = lines[name].last_m - RIM_M
        spawned[name] = SpawnPoint(start, min(max(start + ROUTE_SHARE * route_m * rng.uniform(0.9, 1.1), least), rim))
    return spawned


def _last_conflict(name: str, start: float, lines: RouteLines) -> float:
    """Return the station of the last conflict [m]."""
    met = [
        found[0] for other in lines if other != name and (found := find_conflict_stations(lines[name], lines[other]))
    ]
    return max((station for station in met if station > start), default=0.0)


def _draw_start(
    name: str, starts: Mapping[str, float], lines: RouteLines, ways: LaneRoutes, edge: float, rng: random.Random
) -> float:
    ahead = [start for other, start in starts.items() if ways[other].lanes[0] == ways[name].lanes[0]]
    if ahead:
        return min(ahead) - rng.uniform(*GAP_M)
    for other, start in starts.items():
        met = find_conflict_stations(lines[name], lines[other])
        if met is not None and met[1] > start:
            due = compute_arrival_s(lines[other], start, met[1]) + rng.uniform(-APART_S, APART_S)
            choices = edge - np.arange(*START_BEFORE_JUNCTION_M, STEP_M)
            return float(min(choices, key=lambda choice: abs(compute_arrival_s(lines[name], choice, met[0]) - due)))
    return edge - rng.uniform(*(WITNESS_M if starts else RUN_UP_M))


def compute_arrival_s(line: RouteLine, start: float, station: float) -> float:
    """Return the time [s] in which blind driving gets from rest at `start` to `station` [m], slower in bends."""
    away = np.arange(0.0, max(station - start, STEP_M) + STEP_M / 2, STEP_M)
    rising = np.diff(np.sqrt(2 * away / BLIND_ACCELERATION))
    bends = np.interp(start + away[1:], np.arange(len(line.xy)), _curve_speed_profile(line))
    return float(np.maximum(rising, STEP_M / bends).sum())


@lru_cache(maxsize=4096)
def _curve_speed_profile(line: RouteLine) -> Float:
    """Return the speed of blind driving [m/s] at the points of a line, except near the start."""
    path = build_path(line.xy, VEHICLE.rear_to_centre)
    speeds = compute_curve_speeds(path, BLIND_SPEED, CONSTANT_SPEED.lateral_acceleration, CONSTANT_SPEED.braking)
    share = np.linspace(0.0, path.goal_s, len(line.xy))
    return np.interp(share, np.arange(len(speeds)) * SPACING_M, speeds)
