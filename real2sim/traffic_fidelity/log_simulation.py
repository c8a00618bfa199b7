"""Runs the scenario of a log in SUMO while everything that SUMO does not drive follows its logged poses."""

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
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

    def sample(self, times: Float) -> tuple[Float, Bool]:
        """Return the same (M, 4) for times (M,) [s], and whether the object is there (M,)."""
        last = len(self.times) - 1
        before = np.searchsorted(self.times, times, side="right") - 1
        row, after = np.maximum(before, 0), np.minimum(before + 1, last)
        is_pose = (before < 0) | (before == last) | (self.times[row] == times)
        step = np.where(is_pose, 1.0, self.times[after] - self.times[row])
        slope = (self.states[after] - self.states[row]) / step[:, None]
        between = slope * (times - self.times[row])[:, None] + self.states[row]
        there = (times >= self.times[0] - 1e-6) & ((times <= self.times[-1] + 1e-6) | self.stays)
        return np.where(is_pose[:, None], self.states[row], between), there


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


@dataclass(frozen=True)
class TimedActors:
    """Road users and obstacles that repeat the log, in every tick of it. N of them, sorted by id."""

    still: Actors
    """Ids, kinds and sizes (N,); no poses."""
    states: Float
    """x, y [m], yaw [rad], speed [m/s] (ticks, 4, N)."""
    present: Bool
    """(ticks, N)"""

    @classmethod
    def from_paths(cls, still: Actors, paths: Sequence[TimedPath], ticks: int) -> "TimedActors":
        """Return the actors whose poses are those of the paths. `still`: their ids, kinds and sizes."""
        times = np.arange(ticks, dtype=np.float64) * DT
        sampled = [path.sample(times) for path in paths]
        states = np.array([state.T for state, _ in sampled]).reshape(-1, 4, ticks)
        present = np.array([there for _, there in sampled], dtype=np.bool_).reshape(-1, ticks)
        return cls(still, np.ascontiguousarray(states.transpose(2, 1, 0)), np.ascontiguousarray(present.T))

    def at(self, tick: int) -> Actors:
        """Return those that are present in a tick."""
        x, y, yaw, speed = self.states[tick]
        everyone = replace(self.still, x=x, y=y, yaw=yaw, speed=speed)
        there = self.present[tick]
        return everyone if there.all() else everyone.take(np.flatnonzero(there))


def build_scripted_actors(scenario: Scenario, ticks: int) -> TimedActors:
    """Return the scripted actors of a converted scenario."""
    actors = sorted(scenario.actors, key=lambda actor: actor.id)
    kinds = [KIND_BY_NAME[actor.kind] for actor in actors]
    still = build_still_actors([actor.id for actor in actors], kinds, [(one.length, one.width) for one in actors])
    return TimedActors.from_paths(still, [build_actor_path(actor) for actor in actors], ticks)


def build_still_actors(ids: Sequence[str], kinds: Sequence[int], sizes: Sequence[tuple[float, float]]) -> Actors:
    """Return actors with sizes (length, width) [m], all poses 0."""
    zeros = np.zeros(len(ids))
    length, width = np.array(sizes, dtype=np.float64).reshape(-1, 2).T
    return Actors(tuple(ids), np.array(kinds, dtype=np.uint8), zeros, zeros, zeros, zeros, length, width)


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
    frames = len(next(iter(tracks.values())).valid)
    cavs = {ego.id: build_track_path(tracks[ego.id], dt_s) for ego in scenario.egos}
    sizes = {ego.id: median_size(tracks[ego.id]) for ego in scenario.egos}
    seen: dict[str, list[tuple[float, float, float, float]]] = {}
    for tick, now in enumerate(run_beside_log(scenario, roads, cavs, sizes, round((frames - 1) * dt_s / DT) + 1)):
        for name, x, y, yaw in zip(now.ids, now.x.tolist(), now.y.tolist(), now.yaw.tolist(), strict=True):
            seen.setdefault(name, []).append((tick * DT, x, y, yaw))
    return SimulatedTraffic({name: _resample(np.array(rows), frames, dt_s) for name, rows in seen.items()})


def run_beside_log(
    scenario: Scenario,
    roads: RoadMap,
    cavs: Mapping[str, TimedPath],
    sizes: Mapping[str, tuple[float, float]],
    ticks: int,
    seed: int = 0,
) -> Iterator[Actors]:
    """Return SUMO's vehicles tick by tick while CAVs and scripted actors repeat the log.

    `sizes`: length and width [m] of the CAVs. Needs the process's only SUMO simulation.
    """
    from mdrive_sumo.sumo import SumoWorld  # only here: the process that starts the workers never simulates

    actors = build_scripted_actors(scenario, ticks)
    with SumoWorld(scenario, roads, sizes, seed) as world:
        for tick in range(ticks):
            egos, scripted = place_egos(cavs, tick * DT), actors.at(tick)
            yield (world.advance(egos, scripted, ()) if tick else world.start(egos, scripted)).actors


def _resample(rows: Float, frames: int, dt_s: float) -> Float:
    """Resample times, x, y, yaw (N, 4) of a vehicle to x, y, yaw (T, 3) in the log's frames."""
    times = np.arange(frames) * dt_s
    there = (times > rows[0, 0] - 1e-6) & (times < rows[-1, 0] + 1e-6)
    columns = (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3]))
    return np.where(
        there[:, None], np.column_stack([np.interp(times, rows[:, 0], column) for column in columns]), np.nan
    )
