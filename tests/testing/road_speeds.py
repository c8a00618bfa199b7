"""A short motorway without SUMO, and CAVs that start on it at speed. No tests in here."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from testing.agents_driving import Box, BoxWorld, ego

LIMIT = 33.33
"""[m/s] 120 km/h."""
LENGTH_M = 700
WIDTH_M = 3.75


def centre_line(lane: int = 0, radius: float = math.inf) -> Float:
    """Points (N, 2) every metre of a lane, 0 the rightmost, of a road to the east that may bend to the left."""
    s, offset = np.arange(LENGTH_M + 1.0), WIDTH_M * lane
    if math.isinf(radius):
        return np.column_stack((s, np.full(len(s), offset)))
    angle, own = s / radius, radius - offset
    return np.column_stack((own * np.sin(angle), radius - own * np.cos(angle)))


def motorway(radius: float = math.inf, limit: float = LIMIT) -> RoadMap:
    """Two lanes of one direction."""
    lanes = {
        f"m_{i}": Lane(f"m_{i}", "m", i, WIDTH_M, limit, Polyline(centre_line(i, radius)), False, (), "", "", {})
        for i in (0, 1)
    }
    return RoadMap("motorway", Path("/nowhere"), lanes, (), (), (), (), (), "none")


def slow_zone(begin_m: int, limit: float, before: float) -> RoadMap:
    """One lane whose limit [m/s] is lower from a place on: m_0 before it, z_0 behind."""
    line = centre_line()
    parts = {"m_0": (line[: begin_m + 1], before), "z_0": (line[begin_m:], limit)}
    lanes = {
        name: Lane(name, name[0], 0, WIDTH_M, speed, Polyline(xy), False, (), "", "", {})
        for name, (xy, speed) in parts.items()
    }
    return RoadMap("motorway", Path("/nowhere"), lanes, (), (), (), (), (), "none")


def fast_ego(name: str, xy: Float, speed: float, limit_s: float | None = None) -> Ego:
    """A CAV that starts at speed [m/s] on its route (N, 2)."""
    return ego(name, xy).model_copy(update={"start_speed": speed, "time_limit_s": limit_s, "lanes": ("m_0",)})


def drive_fast(
    agent: str,
    egos: Sequence[Ego],
    boxes: Sequence[Box] = (),
    roads: RoadMap | None = None,
    config: Mapping[str, float] | None = None,
    sensing: str = "perfect",
) -> EpisodeRecord:
    """One episode on the motorway, where the limits of the road count."""
    scenario = Scenario(id="fast", bucket="Hard", category="test", network="motorway", speeds="road", egos=tuple(egos))
    drivers = {one.id: LocalDriver(AGENTS[agent](config or {})) for one in egos}
    options = EpisodeOptions.parse(sensing=sensing, ids="scenario")
    return run_episode(EpisodeConfig(scenario, roads or motorway(), seed=0, options=options), BoxWorld(boxes), drivers)


def find_speeds(episode: EpisodeRecord, column: int = 0) -> Float:
    """The speed [m/s] of a CAV in every tick in which it is there."""
    return episode.speed[:, column][episode.valid[:, column]]
