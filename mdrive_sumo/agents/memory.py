"""`memory`: an agent without sensors that repeats recorded drives, which shows what can be learned by heart."""

import hashlib
import io
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.sensorless import ConstantSpeedAgent
from mdrive_sumo.contract import Briefing, Cause, Observation, Plan, Reason, Reply
from mdrive_sumo.contract.agent_options import Config, read_options
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.input_files import read_bytes

DRIVES_FILE = Path(__file__).with_name("memory_drives.npz")
"""The drives of `omniscient` on the 225 scenarios of season 0; `python -m tools.build_memory_drives` makes it."""
DRIVES_CHECKSUM = "77d009a5bf97d9655f104a93af0c4d448c8d7d6f6093464be511e40946109023"
"""SHA-256 of the packaged drives."""
SAMPLE_S = 0.25
"""Time between two points of a drive [s]: at 10 m/s in a 10 m bend the chord is 8 cm inside the arc."""
RESOLUTION_M = 0.01
"""Unit of the coordinates in the file [m]."""
GOAL_TOLERANCE_M = 1.0
"""A drive that ends farther from the goal is another one: a seed moves no goal."""
START_TOLERANCE_M = 4.0
"""Largest distance of the start from the first seconds of the drive [m]: a seed shifts it by 3 m along the route."""
START_SAMPLES = 12
"""Points of the first 3 s: where a CAV that starts in motion is when a seed trims the log of its scenario."""
SAME_LIMIT_S = 0.01
"""Time limits that differ by less are the same [s]: the file has 32 bits of each."""
MOVING_SPEED = 1.0
"""[m/s] A drive that begins faster is entered where the CAV is, not at its beginning."""
PLAN_POINTS = 12
"""Points of a plan: 3 s ahead."""
AFTER_S = 5.0
"""A drive goes on so long at its last speed [s]: a car that lags behind still reaches the goal."""


@dataclass(frozen=True, slots=True)
class KnownDrives:
    """Recorded drives of D CAVs with P points in all, a point every `SAMPLE_S`."""

    goals: Float
    """(D, 2) last point of the route of each [m]."""
    time_limits: Float
    """(D,) time limit of each [s], which no seed changes: scenarios on one road differ in it."""
    firsts: Int
    """(D + 1,) index of the first point of each drive, and P."""
    points: Float
    """(P, 2) positions of the box centre [m]."""

    def find(self, start: Float, goal: Float, time_limit_s: float) -> Float | None:
        """Return the (N, 2) points of the drive from a start to a goal, (2,) each [m]; None: it knows none.

        Of several it is one with the time limit [s], and of those the one whose beginning lies nearest.
        """
        best: Float | None = None
        least = (True, START_TOLERANCE_M)
        for i in np.flatnonzero(_measure_distances(self.goals, goal) <= GOAL_TOLERANCE_M).tolist():
            drive = self.points[self.firsts[i] : self.firsts[i + 1]]
            distance = float(_measure_distances(drive[:START_SAMPLES], start).min())
            key = (abs(float(self.time_limits[i]) - time_limit_s) > SAME_LIMIT_S, distance)
            if distance <= START_TOLERANCE_M and key <= least:
                best, least = drive, key
        return best


def pack_drives(goals: Float, time_limits: Float, drives: list[Float]) -> bytes:
    """Return the content of a file of drives.

    goals: (D, 2) [m]. time_limits: (D,) [s]. drives: (N, 2) points of each [m].
    """
    quanta = [np.round(drive / RESOLUTION_M).astype(np.int64) for drive in drives]
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        goals=np.round(goals / RESOLUTION_M).astype(np.int32),
        time_limits=time_limits.astype(np.float32),
        lengths=np.array([len(drive) for drive in drives], dtype=np.int32),
        starts=np.array([drive[0] for drive in quanta], dtype=np.int32),
        steps=np.concatenate([np.diff(drive, axis=0) for drive in quanta]).astype(np.int16),
    )
    return buffer.getvalue()


def unpack_drives(content: bytes) -> KnownDrives:
    """Return the drives of a file."""
    with np.load(io.BytesIO(content)) as arrays:
        names = ("goals", "time_limits", "lengths", "starts", "steps")
        goals, time_limits, lengths, starts, steps = (arrays[name] for name in names)
    firsts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    points = np.empty((int(firsts[-1]), 2), dtype=np.float64)
    used = 0
    for i, length in enumerate(lengths.tolist()):
        drive = np.concatenate([[starts[i]], steps[used : used + length - 1]]).astype(np.int64).cumsum(axis=0)
        points[firsts[i] : firsts[i + 1]] = drive * RESOLUTION_M
        used += length - 1
    return KnownDrives(goals * RESOLUTION_M, time_limits.astype(np.float64), firsts, points)


@lru_cache(maxsize=1)
def load_drives() -> KnownDrives:
    """Return the packaged drives. Raises InputError for a file that was changed."""
    content = read_bytes(DRIVES_FILE)
    found = hashlib.sha256(content).hexdigest()
    if found != DRIVES_CHECKSUM:
        raise InputError(
            f"agent memory: {DRIVES_FILE}: expected the packaged drives with checksum {DRIVES_CHECKSUM[:12]}, found"
            f" {found[:12]}; install mdrive-sumo again"
        )
    return unpack_drives(content)


class MemoryAgent(ConstantSpeedAgent):
    """Repeats a drive of `omniscient` in season 0 that it finds by start and goal, without sensors or messages.

    What it scores, anyone can score who has learned the scenarios by heart. Where it knows no drive, as in another
    season, it drives blindly at a constant speed.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        """Read no options. Raises InputError for any, and for changed drives."""
        read_options("memory", config, {})
        super().__init__({})
        self._drives = load_drives()

    def start(self, briefing: Briefing) -> None:
        """Find the drive from the start to the goal."""
        super().start(briefing)
        start = briefing.route_xy[0]
        drive = self._drives.find(start, briefing.route_xy[-1], briefing.time_limit_s)
        self._replay = None if drive is None else DriveReplay(drive, start)

    def act(self, seen: Observation) -> Reply:
        """Return a plan along the drive; without one the plan of `constant-speed`."""
        if self._replay is None:
            return super().act(seen)
        plan = self._replay.plan(seen.tick * self._tick_s)
        return Reply(plan=plan, notes=self._reasons.record(Reason(Cause.MEMORY)))


class DriveReplay:
    """A drive that a car repeats: at each time it shall be where the recorded one was, but not behind its start."""

    def __init__(self, drive: Float, start: Float) -> None:
        """drive: (N, 2) points [m]. start: (2,) where the car starts [m]."""
        last_step = drive[-1] - drive[-2] if len(drive) > 1 else np.zeros(2)
        after = drive[-1] + last_step * np.arange(1, round(AFTER_S / SAMPLE_S) + 1)[:, None]
        points = np.concatenate([drive, after])
        steps = _measure_distances(points[1:], points[:-1])
        self._arcs = np.concatenate([[0.0], np.cumsum(steps)])
        self._times = np.arange(len(points)) * SAMPLE_S
        has_moved = np.concatenate([[True], steps > 0.0])  # the points at which the car stands have one arc length
        self._known_arcs, self._known_points = self._arcs[has_moved], points[has_moved]
        nearest = int(np.argmin(_measure_distances(drive[:START_SAMPLES], start)))
        begins_in_motion = len(drive) > 1 and bool(steps[0] > MOVING_SPEED * SAMPLE_S)
        self._begin_s = nearest * SAMPLE_S if begins_in_motion else 0.0
        self._first_arc = self._project(start)

    def plan(self, time_s: float) -> Plan:
        """Return where the car shall be after `time_s` [s] of the episode."""
        times = self._begin_s + time_s + SAMPLE_S * np.arange(1, PLAN_POINTS + 1)
        arcs = np.maximum(np.interp(times, self._times, self._arcs), self._first_arc)
        points = [np.interp(arcs, self._known_arcs, self._known_points[:, axis]) for axis in (0, 1)]
        return Plan(np.stack(points, axis=1), SAMPLE_S)

    def _project(self, start: Float) -> float:
        """Return the arc length [m] of the point of the first 3 s that lies nearest to the start."""
        first, steps = self._known_points[: START_SAMPLES + 1], np.diff(self._known_points[: START_SAMPLES + 1], axis=0)
        if not len(steps):
            return 0.0
        lengths = np.diff(self._known_arcs[: START_SAMPLES + 1])
        shares = np.clip(((start - first[:-1]) * steps).sum(axis=1) / (lengths * lengths), 0.0, 1.0)
        nearest = int(np.argmin(_measure_distances(first[:-1] + shares[:, None] * steps, start)))
        return float(self._known_arcs[nearest] + shares[nearest] * lengths[nearest])


def _measure_distances(points: Float, others: Float) -> Float:
    """Return the distances [m] of points (..., 2)."""
    steps = points - others
    return portable.hypot(steps[..., 0], steps[..., 1])
