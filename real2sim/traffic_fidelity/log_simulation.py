"""Runs the scenario of a log in SUMO while everything that SUMO does not drive follows its logged poses."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Actors, EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor, ReplayMotion
from real2sim.fit.background_vehicle import median_size
from real2sim.recording import RecordedTrack


@dataclass(frozen=True)
class TimedPath:
    """Timed poses of an object that repeats the log: times (N,) [s], x, y, yaw, speed (N, 4)."""

    times: Float
    states: Float
    stays: bool = False

    @cached_property
    def _rows(self) -> tuple[list[float], list[tuple[float, ...]]]:
        """Times and states as plain numbers: a look-up of one row of arrays takes four times as long."""
        return self.times.tolist(), list(map(tuple, self.states.tolist()))

    def at(self, time: float) -> tuple[float, ...] | None:
        """x, y [m], yaw [rad], speed [m/s]; None before and after."""
        times, states = self._rows
        if time < times[0] - 1e-6 or (time > times[-1] + 1e-6 and not self.stays):
            return None
        k = bisect_right(times, time) - 1  # the last pose before or at that time
        if k < 0 or k == len(times) - 1 or times[k] == time:
            return states[max(k, 0)]
        passed, step = time - times[k], times[k + 1] - times[k]
        return tuple([(b - a) / step * passed + a for a, b in zip(states[k], states[k + 1], strict=True)])


def build_track_path(track: RecordedTrack, dt_s: float) -> TimedPath:
    """Return the timed poses of a track."""
    rows = track.valid_frames
    xy, yaw = track.xy[rows], np.unwrap(np.nan_to_num(track.yaw[rows]))
    times = rows.astype(np.float64) * dt_s
    return TimedPath(times, np.column_stack((xy, yaw, _compute_speeds(xy, times))))


def _compute_speeds(xy: Float, times: Float) -> Float:
    """[m/s] (N,)"""
    if len(times) < 2:
        return np.zeros(len(times))
    x, y = (np.asarray(np.gradient(column, times), dtype=np.float64) for column in xy.T)
    return np.hypot(x, y)


def build_actor_path(actor: Actor) -> TimedPath:
    """Return the timed poses of an actor of a converted scenario, which repeats its track or stands."""
    if not isinstance(actor.motion, ReplayMotion):
        start = actor.start
        return TimedPath(np.zeros(1), np.array([[start.x, start.y, start.yaw, 0.0]]), stays=True)
    timed = np.array(actor.motion.poses)
    speed = _compute_speeds(timed[:, 1:3], timed[:, 0])
    return TimedPath(timed[:, 0], np.column_stack((timed[:, 1:], speed)), actor.motion.stays)


def place_egos(cavs: Mapping[str, TimedPath], time: float) -> dict[str, EgoState]:
    """Return the states of the CAVs that are present at `time` [s]."""
    now = ((name, path.at(time)) for name, path in cavs.items())
    return {name: EgoState(*state) for name, state in now if state is not None}


def place_actors(actors: Sequence[tuple[Actor, TimedPath]], time: float) -> Actors:
    """Return the scripted actors that are present at `time` [s]."""
    now = [(actor, state) for actor, path in actors if (state := path.at(time)) is not None]
    if not now:
        return Actors.empty()
    x, y, yaw, speed = np.array([state for _, state in now]).T
    return Actors(
        tuple(actor.id for actor, _ in now),
        np.array([KIND_BY_NAME[actor.kind] for actor, _ in now], dtype=np.uint8),
        x,
        y,
        yaw,
        speed,
        np.array([actor.length for actor, _ in now]),
        np.array([actor.width for actor, _ in now]),
    )


@dataclass(frozen=True)
class SimulatedTraffic:
    """Background vehicles in the log's frames: x, y, yaw (T, 3) [m, rad] by name, NaN where a vehicle is absent."""

    poses: Mapping[str, Float]

    def xy(self, name: str, frames: int) -> Float:
        """Return positions (T, 2) [m]; all NaN for a vehicle that never appeared."""
        return self.poses[name][:, :2] if name in self.poses else np.full((frames, 2), np.nan)


def simulate_log(
    scenario: Scenario, roads: RoadMap, tracks: Mapping[str, RecordedTrack], dt_s: float
) -> SimulatedTraffic:
    """Run the scenario until the log ends. `tracks`: by id in the scenario; CAVs follow theirs."""
    from mdrive_sumo.sumo import SumoWorld  # only here: the process that starts the workers never simulates

    frames = len(next(iter(tracks.values())).valid)
    cavs = {ego.id: build_track_path(tracks[ego.id], dt_s) for ego in scenario.egos}
    actors = [(actor, build_actor_path(actor)) for actor in sorted(scenario.actors, key=lambda actor: actor.id)]
    sizes = {ego.id: median_size(tracks[ego.id]) for ego in scenario.egos}
    seen: dict[str, list[tuple[float, float, float, float]]] = {}
    with SumoWorld(scenario, roads, sizes, 0) as world:
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
    return np.where(
        there[:, None], np.column_stack([np.interp(times, rows[:, 0], column) for column in columns]), np.nan
    )
