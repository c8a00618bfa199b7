"""A busy V2XPnP log out of SUMO: 10 s at a junction with lights, 84 road users, two CAVs and two stations.

SUMO drives the vehicles, people on foot and parked cars beside the road are scripted.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import Observation
from mdrive_sumo.core.state import TICKS_PER_SECOND, FailureReason
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver
from mdrive_sumo.roads import Lane, RoadMap, build_lane_route, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion
from mdrive_sumo.sumo import SumoWorld
from real2sim.recording import Recording
from real2sim.writers.episode_recording import record_episode
from real2sim.writers.observation_noise import ObservationNoise
from real2sim.writers.v2xpnp import write_v2xpnp
from real2sim.writers.v2xpnp_map import write_vector_map

NETWORK = "boulevard"
WAYS = (("west_in_2", "east_out_1"), ("south_in_1", "north_out_1"))
"""First and last lane of the CAVs."""
SECONDS = 10.0
PARKED = "parked"
NOT_PLACED = 12
"""So many vehicles may find no room."""
ACTORS = 84
GAP_M = 16.0
"""From one vehicle to the next on a lane at the start."""
WALK_M, KERB_M = 4.5, 8.0
"""How far to the right of the outermost lane people walk and cars are parked."""


@dataclass(frozen=True)
class Crowd:
    """How many of each, CAVs apart; SUMO cannot place all vehicles, parked cars make up for that, up to `all`."""

    vehicles: int = 64
    walkers: int = 12
    all: int = ACTORS


BUSY = Crowd()
QUIET = Crowd(vehicles=24, walkers=8, all=36)
"""Most tests need no more."""
USUAL = ObservationNoise()


@dataclass(frozen=True)
class Driven:
    """What was driven, and where."""

    scenario: Scenario
    roads: RoadMap
    episode: EpisodeRecord


def make_busy_log(
    folder: Path, noise: ObservationNoise | None = USUAL, seed: int = 0, crowd: Crowd = BUSY
) -> tuple[Path, Path]:
    """Writes folder/busy (agents 1, 2, -1, -2; 101 frames) and folder/map.pkl; returns both."""
    truth = busy_truth(seed, crowd)
    write_v2xpnp(truth, folder / "busy", noise, seed)
    write_vector_map(truth.map, folder / "map.pkl")
    return folder / "busy", folder / "map.pkl"


def busy_truth(seed: int = 0, crowd: Crowd = BUSY, seconds: float = SECONDS) -> Recording:
    """The log without any error: all tracks in the first view, stations as further views."""
    driven = drive(seed, crowd)
    truth = record_episode(driven.episode, driven.scenario, driven.roads, (0.0, seconds))
    tracks = sorted(truth.views[0].tracks, key=lambda track: track.id.startswith(PARKED))
    return replace(truth, views=(replace(truth.views[0], tracks=tuple(tracks[: crowd.all])), *truth.views[1:]))


class BriefDriver(LocalDriver):
    """Drives no longer than the log is: its CAV then brakes, and the episode ends instead of waiting at the lights."""

    def ask(self, observation: Observation) -> None:
        if observation.tick > SECONDS * TICKS_PER_SECOND:
            raise AgentFailure(FailureReason.CRASHED, "the log ends")
        super().ask(observation)


@cache
def drive(seed: int = 0, crowd: Crowd = BUSY) -> Driven:
    """CAVs driven by IDM among SUMO's vehicles, without messages; driven once a session."""
    roads = load_road_map(find_network_folder(NETWORK))
    egos = tuple(ego(roads, str(n), way) for n, way in enumerate(WAYS))
    rng = np.random.default_rng(seed)
    scenario = Scenario(
        id="busy",
        bucket="Test",
        category="test",
        network=NETWORK,
        signals="program",
        egos=egos,
        background=Background(vehicles=traffic(roads, egos, crowd.vehicles, rng)),
        actors=tuple(beside_the_road(roads, crowd, rng)),
        rsus=(RoadsideUnit(id="post-a", x=14.0, y=16.0), RoadsideUnit(id="post-b", x=-14.0, y=-16.0)),
    )
    drivers = {ego.id: BriefDriver(AGENTS["idm"]({})) for ego in egos}
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in egos}
    config = EpisodeConfig(scenario, roads, seed, options=EpisodeOptions.parse(comm="off"))
    with SumoWorld(scenario, roads, sizes, seed) as world:
        return Driven(scenario, roads, run_episode(config, world, drivers))


def ego(roads: RoadMap, name: str, way: tuple[str, str]) -> Ego:
    """A CAV from 30 m on its first lane to 10 m before the end of its last."""
    lanes = find_lane_path(roads, *way)
    route = build_lane_route(roads, lanes, 30.0, roads.lanes[way[1]].centre.length - 10.0)
    points = tuple((float(x), float(y), float(yaw)) for (x, y), yaw in zip(route.xy, route.yaw, strict=True))
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), start_speed=5.0, lanes=lanes, route=points)


def traffic(
    roads: RoadMap, egos: tuple[Ego, ...], count: int, rng: np.random.Generator
) -> tuple[BackgroundVehicle, ...]:
    """Vehicles on all lanes, not within 15 m of a CAV."""
    starts = np.array([(ego.start.x, ego.start.y) for ego in egos])
    free = [
        (lane, s)
        for lane in roads.driving
        if not lane.junction
        for s in np.arange(10.0, lane.centre.length - 5.0, GAP_M).tolist()
        if np.hypot(*(starts - lane.centre.at(s)).T).min() > 15.0
    ]
    chosen = sorted(rng.choice(len(free), count, replace=False).tolist())
    return tuple(vehicle(roads, f"bg{n}", free[k], rng) for n, k in enumerate(chosen))


def vehicle(roads: RoadMap, name: str, place: tuple[Lane, float], rng: np.random.Generator) -> BackgroundVehicle:
    """A vehicle that goes where one of its lane's ways leads; one in eight is a lorry."""
    lane, s = place
    nexts = sorted({road.edge for way in lane.successors for road in beyond(roads, roads.lanes[way])})
    length, width = (
        (7.5, 2.4) if rng.random() < 0.125 else (float(rng.uniform(4.1, 5.0)), float(rng.uniform(1.7, 1.95)))
    )
    return BackgroundVehicle(
        id=name,
        depart_s=0.0,
        edges=(lane.edge, *rng.choice(nexts, 1).tolist()) if nexts else (lane.edge,),
        depart_lane=lane.index,
        depart_pos_m=s,
        depart_speed=float(rng.uniform(4.0, 7.0)),
        length=round(length, 2),
        width=round(width, 2),
    )


def beyond(roads: RoadMap, way: Lane) -> list[Lane]:
    """The roads behind a way through the junction."""
    if not way.junction:
        return [way]
    return [road for after in way.successors for road in beyond(roads, roads.lanes[after])]


def beside_the_road(roads: RoadMap, crowd: Crowd, rng: np.random.Generator) -> Iterator[Actor]:
    """People who walk, and cars that are parked, to the right of the outermost lanes."""
    edges = [lane for lane in roads.driving if not lane.junction and not lane.right]
    for n in range(crowd.walkers):
        begin = 20.0 + 15.0 * (n // len(edges))
        points = tuple(beside(edges[n % len(edges)], s, WALK_M)[:2] for s in np.arange(begin, begin + 45.0, 3.0))
        x, y, yaw = beside(edges[n % len(edges)], begin, WALK_M)
        speed = round(float(rng.uniform(0.8, 1.6)), 2)
        yield Actor(
            id=f"walker{n}",
            kind="pedestrian",
            length=0.5,
            width=0.6,
            start=Pose(x=x, y=y, yaw=yaw),
            motion=PathMotion(points=points, speed=speed, start_speed=speed),
        )
    for n in range(max(crowd.all - crowd.walkers - crowd.vehicles + NOT_PLACED, 0)):
        x, y, yaw = beside(edges[n % len(edges)], 25.0 + 9.0 * (n // len(edges)), KERB_M)
        yield Actor(id=f"{PARKED}{n}", kind="vehicle", length=4.5, width=1.8, start=Pose(x=x, y=y, yaw=yaw))


def beside(lane: Lane, s: float, right_m: float) -> tuple[float, float, float]:
    """Pose to the right of a lane's centre, at arc length s."""
    (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
    return x + right_m * float(np.sin(yaw)), y - right_m * float(np.cos(yaw)), yaw
