"""Jobs that misbehave: top-level functions that worker processes can import. No tests in here."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo import cli
from mdrive_sumo.errors import InputError, WorldError
from mdrive_sumo.scenario.catalog import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scenario.spec import Ego, Pose, Scenario
from mdrive_sumo.score import ScenarioResult, void_result
from mdrive_sumo.suite import run
from mdrive_sumo.suite.job import Job


@dataclass(frozen=True)
class Task:
    """What a fake job shall do, and a folder to remember it in."""

    name: str
    deed: str = "answer"
    folder: str = ""


def perform(task: Task) -> str:
    """Does the task's deed; answers "<name> <pid>"."""
    if task.folder:
        (Path(task.folder) / f"{task.name}.started").write_text(str(os.getpid()))
    deeds.get(task.deed, lambda _: None)(task)
    return f"{task.name} {os.getpid()}"


def _kill(_: Task) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _kill_first_time(task: Task) -> None:
    mark = Path(task.folder) / f"{task.name}.tried"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def _segfault(_: Task) -> None:
    ctypes.string_at(0)


def _leave(_: Task) -> None:
    os._exit(7)


def _raise(_: Task) -> None:
    raise ZeroDivisionError("no\nnumber")


def _input(_: Task) -> None:
    raise InputError("the map: expected a road, found the sea")


def _full(_: Task) -> None:
    with Path("/dev/full").open("w") as file:
        file.write("x")


def _hang(_: Task) -> None:
    time.sleep(600)


def _hang_once(task: Task) -> None:
    mark = Path(task.folder) / f"{task.name}.tried"
    if not mark.exists():
        mark.touch()
        time.sleep(600)


def _hang_with_child(task: Task) -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    (Path(task.folder) / "child").write_text(str(child.pid))
    time.sleep(600)


def _interrupt_self(_: Task) -> None:
    os.kill(os.getpid(), signal.SIGINT)


def _nap(_: Task) -> None:
    time.sleep(0.3)


def _world(_: Task) -> None:
    raise WorldError("SUMO lost the road")


deeds = {
    "kill": _kill,
    "kill first time": _kill_first_time,
    "segfault": _segfault,
    "leave": _leave,
    "raise": _raise,
    "input": _input,
    "full": _full,
    "hang": _hang,
    "hang once": _hang_once,
    "hang with child": _hang_with_child,
    "interrupt self": _interrupt_self,
    "nap": _nap,
    "world": _world,
}


NETWORK = {
    "name": "flat",
    "origin": "made for this test",
    "licence": "Apache-2.0",
    "offset": (0.0, 0.0),
    "build": (),
    "checksum": "sha256:",
}


def make_suite(folder: Path, *deeds: str) -> Suite:
    """A suite on disk whose scenarios "s0", "s1" ... make `drive` do those deeds."""
    scenarios = tuple(_scenario(f"s{i}", deed) for i, deed in enumerate(deeds))
    save_suite(Suite(SuiteFile(name="tiny", title="A tiny suite"), folder, scenarios))
    network = folder / "networks" / "flat"
    network.mkdir(parents=True, exist_ok=True)
    (network / "network.json").write_text(json.dumps(NETWORK))
    (network / "map.net.xml.gz").touch()
    return load_suite(str(folder))


def _scenario(name: str, deed: str) -> Scenario:
    ego = Ego(id="0", start=Pose(x=0, y=0, yaw=0), lanes=("a_0",), route=((0, 0, 0), (1, 0, 0)))
    return Scenario(id=name, bucket="Tiny", category="deed", network="flat", description=deed, egos=(ego,))


def drive(job: Job) -> ScenarioResult:
    """Stands in for `run_job`: does the deed that the scenario's description names, and notes that it was called."""
    run_folder = Path(job.recording).parents[1] if job.recording else Path(job.suite_folder)
    with (run_folder / "calls").open("a") as calls:
        calls.write(job.scenario + "\n")
    scenario = next(s for s in load_suite(job.suite_folder).scenarios if s.id == job.scenario)
    perform(Task(job.scenario, scenario.description, str(run_folder)))
    if job.recording:
        Path(job.recording).write_text("recorded")
    score = 10.0 * int(job.scenario[1:]) + job.seed
    return void_result(scenario, job.seed, "").model_copy(
        update={"status": "ok", "ds": score, "rc": score, "ip": 1.0, "digest": f"{job.seed:016x}", "ticks": 1}
    )


def main() -> None:
    """The command line with `drive` in place of the simulation."""
    run.run_job = drive
    cli.main()
