"""Runs of `suite_fakes` for tests of pages of whole runs: scores without a simulation. No tests in here."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from mdrive_sumo.cli import main
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import Infraction, ScenarioResult
from testing import suite_fakes
from testing.local_executor import LocalExecutor

HOSTILE = '</script><script>document.title="owned"</script><img src=x onerror=alert(1)>'
HIT, STOOD = 30, 400
"""Ticks of the collision and of the end of a CAV that is blocked."""


def hit(other: str = "npc", speed: float | None = 2.5) -> Infraction:
    """A collision with a vehicle."""
    return Infraction(kind="collision-vehicle", tick=HIT, x=0, y=0, factor=0.6, other=other, impact_speed=speed)


def stood() -> Infraction:
    """The mark of a CAV that is blocked."""
    return Infraction(kind="blocked", tick=STOOD, x=0, y=0, factor=1.0, other="")


def succeed(result: ScenarioResult) -> ScenarioResult:
    """The same episode without a loss."""
    best = {"ds": 100.0, "rc": 100.0, "ip": 1.0}
    ego = result.egos[0].model_copy(update={**best, "outcome": End.ARRIVED})
    return result.model_copy(update={**best, "sr": 100.0, "egos": (ego,)})


def lose(result: ScenarioResult, *infractions: Infraction, **changed: Any) -> ScenarioResult:
    """The same episode with infractions, scored as they cost."""
    ip = math.prod(infraction.factor for infraction in infractions)
    scores = {"rc": result.rc, "ip": ip, "ds": result.rc * ip}
    ego = result.egos[0].model_copy(update={**scores, "ticks": STOOD, "infractions": infractions, **changed})
    return result.model_copy(update={**scores, "ticks": STOOD + 1, "egos": (ego,)})


def fail(result: ScenarioResult, job: EpisodeJob, reason: str) -> ScenarioResult:
    """The same episode with an agent that fails and leaves a log."""
    if job.recording is not None:
        folder = suite_fakes.find_run_folder(job.recording) / "logs"
        log = folder / f"seed{job.seed}" / f"{job.scenario}.0.log"
        for path in (log, folder / log.name):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"Traceback (most recent call last):\n{reason}\n")
    mark = Infraction(kind="agent-failed", tick=HIT, x=0, y=0, factor=0.6, other="")
    return lose(result, mark, outcome=End.AGENT_FAILED, reason=f"crashed: {reason}")


def drive_story(job: EpisodeJob) -> ScenarioResult:
    """s0 hits a vehicle and stands, s1 succeeds, s2's agent fails; with seed M the DS of sN is 6 N + 0.6 M."""
    result = suite_fakes.drive(job)
    if job.scenario == "s1":
        return succeed(result)
    if job.scenario == "s2":
        return fail(result, job, f"ValueError: {HOSTILE}")
    return lose(result, hit(HOSTILE), stood())


def make_run(
    folder: Path, *words: str, name: str = "run", drive: Callable[[EpisodeJob], ScenarioResult] = drive_story
) -> Path:
    """Drive the suite of three scenarios in `folder`/suite, and return the run folder, `folder`/`name`."""
    if not (folder / "suite").is_dir():
        suite_fakes.make_suite(folder / "suite", "answer", "answer", HOSTILE)
    run = folder / name
    arguments = ["eval", "--suite", str(folder / "suite"), "--agent", "stationary", "--out", str(run), *words]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
        patch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
        patch.setattr("testing.suite_fakes.perform", lambda _: None)
        ended = CliRunner().invoke(main, arguments)
    assert ended.exit_code in (0, 1), ended.output
    return run


def edit_results(run: Path, change: Callable[[Any], None]) -> None:
    """Change the results file of a run."""
    path = run / "results.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
