"""Runs the scenario of a log in SUMO while everything that SUMO does not drive follows its logged poses."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo import SumoWorld
from real2sim.fit.background_vehicle import median_size
from real2sim.recording import RecordedTrack
from real2sim.traffic_fidelity.timed_path import build_actor_path, build_track_path, place_actors, place_egos


@dataclass(frozen=True)
class SimulatedTraffic:
    """Background vehicles in the log's frames: x, y, yaw (T, 3) [m, rad] by name, NaN where a vehicle is absent."""

    poses: Mapping[str, Float]

    def xy(self, name: str, frames: int) -> Float:
        """Return positions (T, 2) [m]; all NaN for a vehicle that never appeared."""
        return self.poses[name][:, :2] if name in self.poses else np.full((frames, 2), np.nan)


def simulate_log(
    scenario: Scenario, roads: RoadMap, tracks: Mapping[str, RecordedTrack], dt_s: float, seed: int = 0
) -> SimulatedTraffic:
    """Run the scenario until the log ends. `tracks`: by id in the scenario; CAVs follow theirs."""
    frames = len(next(iter(tracks.values())).valid)
    cavs = {ego.id: build_track_path(tracks[ego.id], dt_s) for ego in scenario.egos}
    actors = [(actor, build_actor_path(actor)) for actor in sorted(scenario.actors, key=lambda one: one.id)]
    sizes = {ego.id: median_size(tracks[ego.id]) for ego in scenario.egos}
    seen: dict[str, list[tuple[float, float, float, float]]] = {}
    with SumoWorld(scenario, roads, sizes, seed) as world:
        for tick in range(round((frames - 1) * dt_s / DT) + 1):
            time = tick * DT
            egos, scripted = place_egos(cavs, time), place_actors(actors, time)
            around = world.advance(egos, scripted, ()) if tick else world.start(egos, scripted)
            now = around.actors
            for name, x, y, yaw in zip(now.ids, now.x.tolist(), now.y.tolist(), now.yaw.tolist(), strict=True):
                seen.setdefault(name, []).append((time, x, y, yaw))
    return SimulatedTraffic({name: _resample(np.array(rows), frames, dt_s) for name, rows in seen.items()})


def _resample(rows: Float, frames: int, dt_s: float) -> Float:
    """Resample times, x, y, yaw (N, 4) of a vehicle to x, y, yaw (T, 3) in the log's frames."""
    times = np.arange(frames) * dt_s
    there = (times > rows[0, 0] - 1e-6) & (times < rows[-1, 0] + 1e-6)
    columns = (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3]))
    return np.where(there[:, None], np.column_stack([np.interp(times, rows[:, 0], one) for one in columns]), np.nan)
