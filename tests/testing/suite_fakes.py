"""A suite without a simulation: tiny scenarios on disk, and a stand-in for `run_job`. No tests in here."""

import gzip
import json
from pathlib import Path
from typing import Any

from mdrive_sumo import cli
from mdrive_sumo.core.state import End
from mdrive_sumo.roads.network_file import compute_net_checksum
from mdrive_sumo.runs import evaluate
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.run_paths import EPISODES_FOLDER
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scoring import EgoResult, ScenarioResult, make_void_result
from testing.pool_fakes import Task, perform

NET = b"""<net version="1.20">
    <location netOffset="0,0" convBoundary="0,0,100,0" origBoundary="0,0,100,0" projParameter="!"/>
    <edge id="a" from="x" to="y" priority="1">
        <lane id="a_0" index="0" speed="13.89" length="100" shape="0,0 100,0"/>
    </edge>
    <junction id="x" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>
    <junction id="y" type="dead_end" x="100" y="0" incLanes="a_0" intLanes="" shape="100,0"/>
</net>"""
NETWORK = {
    "name": "flat",
    "origin": "made for this test",
    "licence": "Apache-2.0",
    "offset": (0.0, 0.0),
    "build": (),
    "checksum": compute_net_checksum(NET),
}


def make_suite(folder: Path, *deeds: str) -> Suite:
    """A suite on disk whose scenarios "s0", "s1" ... make `drive` do those deeds."""
    scenarios = tuple(_scenario(f"s{i}", deed) for i, deed in enumerate(deeds))
    save_suite(Suite(SuiteFile(name="tiny", title="A tiny suite"), folder, scenarios))
    network = folder / "networks" / "flat"
    network.mkdir(parents=True, exist_ok=True)
    (network / "network.json").write_text(json.dumps(NETWORK))
    (network / "map.net.xml.gz").write_bytes(gzip.compress(NET, mtime=0))
    return load_suite(str(folder))


def _scenario(name: str, deed: str) -> Scenario:
    ego = Ego(id="0", start=Pose(x=0, y=0, yaw=0), lanes=("a_0",), route=((0, 0, 0), (1, 0, 0)))
    return Scenario(id=name, bucket="Tiny", category="deed", network="flat", description=deed, egos=(ego,))


def drive(job: EpisodeJob) -> ScenarioResult:
    """Stands in for `run_job`: does the deed that the scenario's description names, and notes that it was called."""
    run_folder = find_run_folder(job.recording) if job.recording else job.suite_folder
    with (run_folder / "calls").open("a") as calls:
        calls.write(job.scenario + "\n")
    scenario = next(s for s in load_suite(str(job.suite_folder)).scenarios if s.id == job.scenario)
    perform(Task(job.scenario, scenario.description, str(run_folder)))
    if job.recording:
        job.recording.write_text("recorded")
    score = 10.0 * int(job.scenario[1:]) + job.seed
    return scored(scenario, job.seed, score, digest=f"{job.seed:016x}")


def find_run_folder(recording: Path) -> Path:
    """The folder of the run that a recording belongs to; seeds have folders of their own in it."""
    return next(folder.parent for folder in recording.parents if folder.name == EPISODES_FOLDER)


def scored(scenario: Scenario, seed: int, score: float, **changed: Any) -> ScenarioResult:
    """A result as it can be: of one CAV that gets so far and no further."""
    same = {"ds": score, "rc": score, "ip": 1.0}
    ego = EgoResult(id="0", outcome=End.BLOCKED, reason="", ticks=1, infractions=(), **same)
    update = {"status": "ok", **same, "ticks": 1, "egos": (ego,), **changed}
    return make_void_result(scenario, seed, "").model_copy(update=update)


def main() -> None:
    """The command line with `drive` in place of the simulation."""
    evaluate.run_job = drive
    cli.main()
