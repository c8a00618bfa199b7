"""Whether SUMO's saved states continue a simulation exactly, against forks and fresh starts: decision 078.

    python tests/bench/saved_states.py

The options are those of the benchmark. Positions of all background vehicles are compared 5 to 15 s after the start.
"""

import os
import pickle
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import libsumo
import numpy as np

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.loop import VEHICLE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sumo import SumoWorld

sys.path.insert(0, str(Path(__file__).parent))
from busy_grid import VEHICLES, busy_scenario, grid

BEFORE, AFTER = 5 * TICKS_PER_SECOND, 10 * TICKS_PER_SECOND
SEEDS = (1, 2, 3)
EXACT_OPTIONS = ("--save-state.rng", "--save-state.precision", "12")
T = TypeVar("T")
Track = dict[str, tuple[float, float]]


class StoredWorld(SumoWorld):
    """The world of the benchmark with more options."""

    more: tuple[str, ...] = ()

    def _command(self) -> list[str]:
        return [*super()._command(), *self.more]


def step(ticks: int) -> list[Track]:
    """Positions of all vehicles after each step."""
    tracks: list[Track] = []
    for _ in range(ticks):
        libsumo.simulationStep()
        tracks.append({name: libsumo.vehicle.getPosition(name) for name in libsumo.vehicle.getIDList()})
    return tracks


def in_fork(work: Callable[[], T]) -> T:
    """The result of work in a fork of this process: libsumo holds one simulation a process."""
    ours, theirs = socket.socketpair()
    pid = os.fork()
    if pid == 0:
        try:
            with theirs.makefile("wb") as pipe:
                pickle.dump(work(), pipe)
        finally:
            os._exit(0)
    theirs.close()
    with ours.makefile("rb") as pipe:
        result = pickle.load(pipe)
    os.waitpid(pid, 0)
    return result


def compare(first: list[Track], second: list[Track]) -> str:
    """The largest distance of a vehicle in any tick, and how often one is missing."""
    missing = sum(len(set(a) ^ set(b)) for a, b in zip(first, second, strict=True))
    shared = [(a[name], b[name]) for a, b in zip(first, second, strict=True) for name in set(a) & set(b)]
    apart = max((float(np.hypot(p[0] - q[0], p[1] - q[1])) for p, q in shared), default=0.0)
    return f"{apart:.3g} m" + (f", {missing} vehicle ticks missing" if missing else "")


@dataclass(frozen=True)
class Continuation:
    """One simulation, continued after 5 s in different ways."""

    scenario: Scenario
    roads: RoadMap
    seed: int
    state: Path

    def _make_world(self, *more: str) -> StoredWorld:
        sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in self.scenario.egos}
        world = StoredWorld(self.scenario, self.roads, sizes, self.seed)
        world.more = (*EXACT_OPTIONS, *more)
        return world

    def run_on(self) -> list[Track]:
        self._make_world().__enter__()
        step(BEFORE)
        libsumo.simulation.saveState(str(self.state))
        return step(AFTER)

    def run_again(self) -> list[Track]:
        self._make_world().__enter__()
        step(BEFORE)
        return step(AFTER)

    def run_forked(self) -> list[Track]:
        self._make_world().__enter__()
        step(BEFORE)
        return in_fork(lambda: step(AFTER))

    def time_fork(self) -> float:
        """Milliseconds of a fork of the process with this simulation."""
        self._make_world().__enter__()
        step(BEFORE)
        begin = time.perf_counter()
        pid = os.fork()
        if pid == 0:
            os._exit(0)
        took_ms = (time.perf_counter() - begin) * 1e3
        os.waitpid(pid, 0)
        return took_ms

    def load_in_process(self) -> list[Track]:
        self._make_world().__enter__()
        step(BEFORE + AFTER)
        libsumo.simulation.loadState(str(self.state))
        return step(AFTER)

    def load_at_start(self) -> list[Track]:
        libsumo.start(self._make_world("--load-state", str(self.state))._command())  # it holds types, vehicles, lights
        return step(AFTER)


def rows(one: Continuation) -> Iterator[tuple[str, str]]:
    expected = in_fork(one.run_on)
    yield "fresh start, same seed", compare(expected, in_fork(one.run_again))
    yield f"fork ({in_fork(one.time_fork):.1f} ms)", compare(expected, in_fork(one.run_forked))
    yield "loadState in the process", compare(expected, in_fork(one.load_in_process))
    yield "--load-state at the start", compare(expected, in_fork(one.load_at_start))


def main() -> None:
    sys.stdout.write(f"{libsumo.getVersion()[1]}, {VEHICLES} vehicles\n")
    with tempfile.TemporaryDirectory() as name:
        roads = grid(Path(name))
        for action_step_s in (0.05, 0.5):
            scenario = busy_scenario(roads, 1, VEHICLES, action_step_s)
            for seed in SEEDS:
                state = Path(name) / f"{seed}-{action_step_s}.xml"
                for what, found in rows(Continuation(scenario, roads, seed, state)):
                    sys.stdout.write(f"action step {action_step_s:g} s, seed {seed}: {what}: {found}\n")
                    sys.stdout.flush()


if __name__ == "__main__":
    main()
