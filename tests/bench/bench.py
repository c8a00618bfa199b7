"""`make bench`: figures with targets, measured in one run, as a table and as bench.json.

Ratios compare medians of interleaved runs in the same process; wall-clock times say what this machine did.
"""

import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import libsumo
import numpy as np

from mdrive_sumo.contract import Reply
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import save_episode
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentDriver, LocalDriver
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import open_agents
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from mdrive_sumo.sumo import SumoWorld

sys.path.insert(0, str(Path(__file__).parent))
from busy_grid import VEHICLES, busy_scenario, grid
from cooperation import channel_row, radio_row, sensor_rows

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"
BIN = Path(sys.executable).parent
ROUNDS = 5
BUSY = 64
"""Scenarios of the parallel run: more than 60 s of work for one worker."""
Row = tuple[str, float, str, str]


class TimedDriver(LocalDriver):
    """A built-in agent whose thinking time is taken out of the evaluator's."""

    spent_s = 0.0

    def answer(self) -> Reply:
        begin = time.perf_counter()
        reply = super().answer()
        TimedDriver.spent_s += time.perf_counter() - begin
        return reply


def evaluator_ticks(scenario: Scenario, roads: RoadMap, agent: str) -> list[float]:
    """Seconds of every tick, agents' thinking taken out."""
    from mdrive_sumo.agents.registry import AGENTS

    times: list[float] = []
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}

    class Clocked(SumoWorld):
        def advance(self, egos: Any, scripted: Any, struck: Any) -> Any:
            times.append(time.perf_counter() - TimedDriver.spent_s)
            return super().advance(egos, scripted, struck)

    TimedDriver.spent_s = 0.0
    drivers: dict[str, AgentDriver] = {ego.id: TimedDriver(AGENTS[agent]({})) for ego in scenario.egos}
    with Clocked(scenario, roads, sizes, 1) as world:
        run_episode(EpisodeConfig(scenario, roads, 0), world, drivers)
    return list(np.diff(times))


def bare_ticks(scenario: Scenario, roads: RoadMap, ticks: int) -> list[float]:
    """Seconds of every step of libsumo alone, reading position, angle and speed of every vehicle."""
    times: list[float] = []
    with SumoWorld(scenario, roads, {}, 1):
        vehicle = libsumo.vehicle
        for _ in range(ticks):
            begin = time.perf_counter()
            libsumo.simulationStep()
            for name in vehicle.getIDList():
                _ = vehicle.getPosition(name), vehicle.getAngle(name), vehicle.getSpeed(name)
            times.append(time.perf_counter() - begin)
    return times


def tick_ratios(roads: RoadMap) -> Iterator[Row]:
    """Evaluator against bare libsumo: 2 CAVs and 84 background vehicles, the first 20 s, interleaved."""
    ticks = 20 * TICKS_PER_SECOND
    for action_step_s, target in ((0.05, 1.5), (0.5, 2.2)):
        scenario = busy_scenario(roads, 2, VEHICLES, action_step_s)
        ours: list[float] = []
        bare: list[float] = []
        for _ in range(ROUNDS):
            ours.append(sum(evaluator_ticks(scenario, roads, "constant-speed")[:ticks]))
            bare.append(sum(bare_ticks(scenario, roads, ticks)))
        ratio = statistics.median(ours) / statistics.median(bare)
        yield (
            f"tick ratio, 2 CAVs + {VEHICLES} vehicles, action step {action_step_s:g} s",
            ratio,
            "x",
            f"<= {target:g}",
        )
        yield (f"  bare libsumo, action step {action_step_s:g} s", statistics.median(bare) / ticks * 1e3, "ms/tick", "")


def lone_tick(roads: RoadMap, folder: Path) -> Iterator[Row]:
    """Four CAVs without background: time of a tick, and size of the recording."""
    scenario = busy_scenario(roads, 4, 0, 0.5)
    ticks = [tick for _ in range(ROUNDS) for tick in evaluator_ticks(scenario, roads, "constant-speed")]
    yield "tick, 4 CAVs, no background", statistics.mean(ticks) * 1e3, "ms", "<= 1.0"
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    with (
        open_agents(AgentSpec("constant-speed"), {ego: ego for ego in sizes}) as drivers,
        SumoWorld(scenario, roads, sizes, 1) as world,
    ):
        episode = run_episode(EpisodeConfig(scenario, roads, 0), world, drivers)
    save_episode(episode, folder / "e.npz")
    minutes = episode.ticks / TICKS_PER_SECOND / 60
    yield (
        "recording, 4 CAVs, a simulated minute",
        (folder / "e.npz").stat().st_size / 1e3 / minutes,
        "kB",
        "< 200",
    )


def command(*arguments: str) -> float:
    """Wall-clock seconds of a command line."""
    begin = time.perf_counter()
    subprocess.run([str(BIN / "mdrive-sumo"), *arguments], check=True, capture_output=True)
    return time.perf_counter() - begin


def command_rows(folder: Path) -> Iterator[Row]:
    """What a user waits for."""
    yield "mdrive-sumo --help", statistics.median(command("--help") for _ in range(7)), "s", "< 0.4"
    if not SHARED.is_dir():
        return
    real = folder / "real"
    routes, towns = str(SHARED / "mdrive" / "interdrive"), str(SHARED / "carla_towns")
    command("convert", "interdrive", routes, "--towns", towns, "--out", str(real))
    one = [str(real), "--agent", "constant-speed", "--out"]
    took = statistics.median(
        command("eval", "--suite", *one, str(folder / f"w{i}"), "--workers", "2") for i in range(3)
    )
    yield "46 real InterDrive scenarios, constant-speed, 2 workers", took, "s", "<= 30"
    together = command("eval", "--suite", *one[:1], "--agent", "sharing+negotiation", "--out", str(folder / "sn"))
    yield "46 real InterDrive scenarios, sharing+negotiation, 2 workers", together, "s", "< 90"


def parallel_row(folder: Path, roads: RoadMap) -> Iterator[Row]:
    """Two workers against one on more than 60 s of work, start-up (a run of one short scenario) taken out."""
    suite, long = folder / "busy", busy_scenario(roads, 2, VEHICLES, 0.05)
    short = long.model_copy(update={"id": "short", "egos": tuple(_cut(ego) for ego in long.egos)})
    copies = [long.model_copy(update={"id": f"busy{i}"}) for i in range(BUSY)]
    save_suite(Suite(SuiteFile(name="busy", title="Busy grid"), suite, (short, *copies)))
    shutil.copytree(roads.folder, suite / "networks" / "grid")

    def took(scenario: str, workers: int) -> float:
        out = folder / f"{scenario.strip('*')}-{workers}"
        return command(
            "eval", "--suite", str(suite), "--agent", "constant-speed", "--scenario", scenario,
            "--workers", str(workers), "--out", str(out), "--fresh",
        )  # fmt: skip

    idle = statistics.median(took("short", 1) for _ in range(3))
    one, two = took("busy*", 1) - idle, took("busy*", 2) - idle
    yield "two workers against one, start-up aside", one / two, "x", ">= 1.8"
    yield "  work of one worker", one, "s", ">= 60"


def memory_rows(roads: RoadMap) -> Iterator[Row]:
    """Growth of a worker over 500 short episodes, and its peak."""
    scenario = busy_scenario(roads, 2, 20, 0.5)
    short = scenario.model_copy(update={"egos": tuple(_cut(ego) for ego in scenario.egos)})
    sizes: list[float] = []
    for i in range(520):
        evaluator_ticks(short, roads, "constant-speed")
        if i >= 20:
            sizes.append(_resident_mb())
    yield "worker, growth over 500 episodes", sizes[-1] - sizes[0], "MB", "< 5"
    yield "worker, peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "MB", "< 400"


def last_rows(folder: Path) -> Iterator[Row]:
    """Scripted road users, conversion, generation: last, for their libraries would count as memory of a worker."""
    from actors import actor_rows
    from conversion import conversion_rows
    from front_door import front_door_rows
    from generation import generation_rows

    yield from actor_rows()
    yield from front_door_rows()
    for name, rows in (("conversion", conversion_rows), ("generation", generation_rows)):
        (folder / name).mkdir()
        yield from rows(folder / name)


def _cut(ego: Ego) -> Ego:
    return ego.model_copy(update={"route": ego.route[:12]})


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Measures everything, prints the table, writes bench.json into the current folder."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "grid").mkdir()
        roads = grid(folder / "grid")
        parts: list[Callable[[], Iterator[Row]]] = [
            lambda: tick_ratios(roads), lambda: lone_tick(roads, folder), lambda: memory_rows(roads),
            lambda: command_rows(folder), lambda: parallel_row(folder, roads), sensor_rows, channel_row, radio_row,
            lambda: last_rows(folder),
        ]  # fmt: skip
        for part in parts:
            for row in part():
                rows.append(row)
                sys.stdout.write(f"{row[0]:<66}{row[1]:>10.2f} {row[2]:<8}{row[3]}\n")
                sys.stdout.flush()
    result = {
        name.strip(): {"value": round(value, 4), "unit": unit, "target": target} for name, value, unit, target in rows
    }
    Path("bench.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
