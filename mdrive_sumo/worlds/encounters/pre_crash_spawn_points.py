"""Spawn points of the CAVs of a pre-crash scenario: close to the junction, so that they meet in it soon and unseen."""

import random
from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.encounters.proposed_actor import ProposedActor
from mdrive_sumo.worlds.lane_routes import locate_junction
from mdrive_sumo.worlds.placement.blind_driving import STEP_M, compute_arrival_s
from mdrive_sumo.worlds.placement.cavs import NoRoomError, SpawnPoint
from mdrive_sumo.worlds.placement.lane_chains import RouteLines, find_conflict_stations
from mdrive_sumo.worlds.placement.spawn_points import (
    RIM_M,
    RUN_OUT_M,
    LaneRoutes,
    StartStations,
    draw_start_behind,
    find_conflicts,
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


def choose_pre_crash_spawn_points(
    actors: Sequence[ProposedActor],
    lines: RouteLines,
    ways: LaneRoutes,
    roads: RoadMap,
    route_m: float,
    rng: random.Random,
) -> dict[str, SpawnPoint]:
    """Return start and goal of every CAV. Raises NoRoomError."""
    behind = {actor.affects_vehicle for actor in actors if actor.timing_phase in ("after_exit", "after_turn")}
    starts: StartStations = {}
    for name, way in ways.items():
        starts[name] = _draw_start(name, starts, lines, ways, locate_junction(roads, way)[0], rng)
        if starts[name] < RIM_M:
            raise NoRoomError(f"{name}: expected room for its start before the junction, found {starts[name]:.0f} m")
    spawned: dict[str, SpawnPoint] = {}
    for name, start in starts.items():
        past = EVENT_PAST_M if name in behind else PAST_M
        last = max((met[0] for _, met in find_conflicts(name, lines) if met[0] > start), default=0.0)
        least = max(last + RUN_OUT_M, locate_junction(roads, ways[name])[1] + past)
        rim = lines[name].last_m - RIM_M
        spawned[name] = SpawnPoint(start, min(max(start + ROUTE_SHARE * route_m * rng.uniform(0.9, 1.1), least), rim))
    return spawned


def _draw_start(
    name: str, starts: Mapping[str, float], lines: RouteLines, ways: LaneRoutes, edge: float, rng: random.Random
) -> float:
    if (behind := draw_start_behind(name, starts, ways, rng)) is not None:
        return behind
    for other, start in starts.items():
        met = find_conflict_stations(lines[name], lines[other])
        if met is not None and met[1] > start:
            due = compute_arrival_s(lines[other], start, met[1]) + rng.uniform(-APART_S, APART_S)
            choices = edge - np.arange(*START_BEFORE_JUNCTION_M, STEP_M)
            return float(min(choices, key=lambda choice: abs(compute_arrival_s(lines[name], choice, met[0]) - due)))
    return edge - rng.uniform(*(WITNESS_M if starts else RUN_UP_M))
