"""What a box costs: starting an agent, and one tick, against the same agent in this process.

    .venv/bin/python tests/bench/sandbox.py [SCENARIO] [--first]

Observations are those of a real scenario, recorded once; both sides then answer the same ones in turns. With --first
(root, control groups of version 1) this process and its boxes run before all other work of the machine, as far as the
kernel allows, so that wall-clock times of a busy machine come near to those of a quiet one. Processor time of a box is
that of its control group, supervisor included.
"""

import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import numpy as np

from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.agent_process.sandbox import BoxLimits
from mdrive_sumo.agent_process.sandbox.cgroups import Cgroup, CgroupHierarchy
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY
from mdrive_sumo.contract import Briefing, Control, Observation, Reply, SensorSpec
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentDriver, LocalDriver
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.sumo import SumoWorld

SENSORS: Mapping[str, tuple[SensorSpec, ...]] = {
    "objects": (SensorSpec("objects"),),
    "objects, lidar": (SensorSpec("objects"), SensorSpec("lidar", "top")),
    "objects, lidar, bev": (SensorSpec("objects"), SensorSpec("lidar", "top"), SensorSpec("bev", "map")),
}
SOURCE = """
from mdrive_sumo.contract import Control, Reply
class Agent:
    label = "single"
    def __init__(self, config): pass
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen): return Reply(control=Control(0.3, 0.0, 0.0))
"""
TICKS = 200
STARTS = 20
LARGEST_SHARES = 262144
"""Of `cpu.shares`; other processes of the machine have 1024."""


class Probe:
    """Drives on and remembers what it saw."""

    label = "single"

    def __init__(self, sensors: tuple[SensorSpec, ...]) -> None:
        self._sensors = sensors
        self.briefing: Briefing | None = None
        self.seen: list[Observation] = []

    def sensors(self) -> tuple[SensorSpec, ...]:
        return self._sensors

    def start(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def act(self, seen: Observation) -> Reply:
        self.seen.append(seen)
        return Reply(control=Control(0.3, 0.0, 0.0))


def recorded(name: str, sensors: tuple[SensorSpec, ...]) -> Probe:
    """The first CAV of a scenario, and what it saw."""
    suite = load_suite("interdrive@0")
    scenario = next(one for one in suite.scenarios if one.id.startswith(name))
    roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
    probes = {ego.id: Probe(sensors if ego is scenario.egos[0] else ()) for ego in scenario.egos}
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    with SumoWorld(scenario, roads, sizes, 0) as world:
        run_episode(
            EpisodeConfig(scenario, roads, seed=0), world, {ego: LocalDriver(one) for ego, one in probes.items()}
        )
    return probes[scenario.egos[0].id]


def times_ms(driver: AgentDriver, probe: Probe) -> list[float]:
    """Of every tick, from the observation to the checked reply; the first ones left out."""
    assert probe.briefing is not None
    driver.sensors()
    driver.start(probe.briefing)
    times: list[float] = []
    for tick in range(TICKS + 20):
        seen = probe.seen[tick % len(probe.seen)]
        since = time.perf_counter()
        driver.ask(seen)
        driver.answer()
        times.append(1000 * (time.perf_counter() - since))
    driver.close()
    return times[20:]


def row(what: str, values: Sequence[float]) -> str:
    """A tenth, median and 99th percentile: on a busy machine the first comes nearest to what it is on an idle one."""
    return f"| {what} | " + " | ".join(f"{value:.3f}" for value in np.percentile(values, (10, 50, 99))) + " |"


def main() -> None:
    """Prints two tables."""
    sys.path[0] = str(Path(__file__).parents[1])  # not this folder, whose `server` is another one
    from testing.small_environment import link_packages

    words = [word for word in sys.argv[1:] if word != "--first"]
    if len(words) < len(sys.argv) - 1:
        run_first()
    name = words[0] if words else "i01"
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        folder.chmod(0o755)
        (folder / "agents.py").write_text(SOURCE)
        (folder / "agent").mkdir()
        (folder / "agents.py").rename(folder / "agent" / "agents.py")
        shared = AgentBox(folder / "agent", python=sys.executable, site=link_packages(folder / "site"))
        own = replace(shared, copies=MEMORY)
        plans = {"box": shared, "box, own files": own}
        if shutil.which("runsc") is not None:
            plans["gVisor, own files"] = replace(own, backend="gvisor")

        def plain() -> RemoteDriver:
            return RemoteDriver(open_agent_connection(AgentProgram(f"{made}/agent/agents.py:Agent"), AgentLimits()), {})

        def boxed(plan: AgentBox = shared) -> RemoteDriver:
            return RemoteDriver(open_agent_connection(AgentProgram("/agent/agents.py:Agent"), AgentLimits(), plan), {})

        boxes = {name: partial(boxed, plan) for name, plan in plans.items()}

        # Before observations are recorded: a process of gigabytes takes longer to fork than an evaluator.
        click.echo("| start, until it has declared its sensors [ms] | p10 | p50 | p99 |\n|---|---|---|---|")
        for where, make in (("child", plain), *boxes.items()):
            make().close()  # the copies of the files are made
            rows = [measure_start(make) for _ in range(STARTS)]
            for what, values in zip(
                ("wall clock", "CPU of the evaluator", "CPU of the agent"), zip(*rows, strict=True), strict=True
            ):
                click.echo(row(f"{where}: {what}", values))
        click.echo("\n| a tick [ms] | p10 | p50 | p99 |\n|---|---|---|---|")
        for what, sensors in SENSORS.items():
            probe = recorded(name, sensors)
            makers: dict[str, Callable[[], AgentDriver]] = {
                "in process": lambda probe=probe: LocalDriver(Probe(probe.sensors())), "child": plain, **boxes
            }  # fmt: skip
            for where, make in makers.items():
                click.echo(row(f"{what}: {where}", times_ms(make(), probe)))
    click.echo("load " + " ".join(f"{load:.1f}" for load in os.getloadavg()))


def run_first() -> None:
    """Give this process and the boxes that it opens more of the processors than all other work."""
    os.nice(-19)
    make = Cgroup.make

    def make_first(hierarchy: CgroupHierarchy, name: str, limits: BoxLimits) -> Cgroup:
        group = make(hierarchy, name, limits)
        (group.folders["cpu"] / "cpu.shares").write_text(str(LARGEST_SHARES))
        return group

    Cgroup.make = staticmethod(make_first)


def measure_start(make: Callable[[], RemoteDriver]) -> tuple[float, float, float]:
    """Until an agent has answered for the first time: wall clock, CPU time of this process and of the agent [ms]."""
    since, own_s = time.perf_counter(), time.process_time()
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    driver = make()
    driver.sensors()
    took, own_s = time.perf_counter() - since, time.process_time() - own_s
    driver.close()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    waited_s = ended.ru_utime + ended.ru_stime - children.ru_utime - children.ru_stime
    box_s = driver.usage_record().get("cpu_s")
    return 1000 * took, 1000 * own_s, 1000 * (waited_s if box_s is None else box_s)


if __name__ == "__main__":
    main()
