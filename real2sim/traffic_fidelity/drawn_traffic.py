"""Samples of traffic that `worlds` draws on drawn places, to compare it with logs as a population."""

import random
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Actors, Frame
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.worlds.places import draw_place, write_place
from mdrive_sumo.worlds.traffic import draw_traffic, find_demand
from real2sim.traffic_fidelity.realism_features import RoadUserStates, compute_features, find_collisions
from real2sim.traffic_fidelity.realism_score import RealismSamples

DRAWN: Mapping[str, tuple[str, ...]] = {
    "town-quiet": ("crossing", "town_block"),
    "town-busy": ("crossing", "corridor"),
    "arterial": ("corridor",),
}
"""Kinds of places by demand: streets of towns, as most logs have them."""
SEEDS = range(3)
BEGIN_S, END_S = 4.0, 24.0
"""[s] Part of a drive that is sampled: queues have begun to move, and it is as long as a window of a log."""
FAR_M = 9e4
"""[m] Where the scenario's CAV is, which nothing meets."""


def sample_drawn(demand: str, stride: int) -> list[RealismSamples]:
    """Return the samples of every place of a demand, each `stride` ticks. Needs the process's only SUMO simulation."""
    samples: list[RealismSamples] = []
    for kind in DRAWN[demand]:
        for seed in SEEDS:
            with tempfile.TemporaryDirectory() as folder:
                roads = load_road_map(write_place(draw_place(kind, seed), Path(folder) / kind))
                samples.append(_drive(roads, demand, seed, stride))
    return samples


def _drive(roads: RoadMap, demand: str, seed: int, stride: int) -> RealismSamples:
    from mdrive_sumo.sumo import SumoWorld  # only here: the process that starts the workers never simulates

    traffic = draw_traffic(roads, (), (), find_demand(demand), random.Random(seed))
    route = ((FAR_M, 0.0, 0.0), (FAR_M + 1.0, 0.0, 0.0))
    far = Ego(id="far", start=Pose(x=FAR_M, y=0.0, yaw=0.0), lanes=(next(iter(roads.lanes)),), route=route)
    scenario = Scenario(
        id="drawn",
        bucket="Drawn",
        category="drawn",
        network=roads.name,
        signals="program",
        egos=(far,),
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
    )
    scripted, frames = ScriptedActors(scenario, roads), list[Actors]()
    with SumoWorld(scenario, roads, {}, seed) as world:
        around = world.start({}, scripted.present)
        for tick in range(round(END_S / DT)):
            frame = Frame(tick, {}, around.actors.merge(scripted.present), around.signals)
            if tick >= BEGIN_S / DT and tick % stride == 0:
                frames.append(frame.actors)
            around = world.advance({}, scripted.advance(frame, ()), ())
    judged = {vehicle.id for vehicle in traffic.vehicles if vehicle.kind == "vehicle"}
    return _sample(frames, judged, roads, stride * DT)


def _sample(frames: list[Actors], judged: set[str], roads: RoadMap, dt_s: float) -> RealismSamples:
    ids = sorted({id_ for actors in frames for id_ in actors.ids})
    column = {id_: k for k, id_ in enumerate(ids)}
    poses: Float = np.full((3, len(frames), len(ids)), np.nan)
    sizes = np.zeros((2, len(ids)))
    for row, actors in enumerate(frames):
        columns = [column[id_] for id_ in actors.ids]
        poses[:, row, columns] = actors.x, actors.y, actors.yaw
        sizes[:, columns] = actors.length, actors.width
    x, y, yaw = poses
    length, width = sizes
    states = RoadUserStates(x, y, yaw, length, width, dt_s)
    features = compute_features(states, np.array([column[id_] for id_ in ids if id_ in judged], dtype=np.int64), roads)
    return RealismSamples(features, find_collisions(features))
