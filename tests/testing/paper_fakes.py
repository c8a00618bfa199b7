"""`study paper` without a simulation: scenarios of two CAVs, and stand-ins for both loops. No tests in here."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from mdrive_sumo.open_loop import OpenLoopScenario
from mdrive_sumo.open_loop.open_loop_job import OpenLoopJob
from mdrive_sumo.report.comparison_report.report_figures import ReportFigure
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scenario.suite import load_suite, save_suite
from mdrive_sumo.scoring import ScenarioResult
from testing import study_fakes, suite_fakes
from testing.local_executor import LocalExecutor


def make_suite(folder: Path, *deeds: str) -> Path:
    """Save a tiny suite whose scenarios have two CAVs each."""
    suite = suite_fakes.make_suite(folder, *deeds)
    scenarios = [
        one.model_copy(update={"egos": (*one.egos, one.egos[0].model_copy(update={"id": "1"}))}) for one in suite
    ]
    save_suite(replace(suite, scenarios=tuple(scenarios)))
    return folder


def drive(job: EpisodeJob) -> ScenarioResult:
    """As `study_fakes.drive`; CAVs of agents that talk hear each other."""
    result = study_fakes.drive(job)
    return result.model_copy(update={"exchanged": {"cam": 1} if result.comm else {}})


def show(job: OpenLoopJob) -> OpenLoopScenario:
    """The longer the name of the agent, the worse its plan."""
    drive_job = job.episode_job
    with (drive_job.suite_folder / "shown").open("a") as shown:
        shown.write(f"{drive_job.agent.name} {drive_job.seed} {drive_job.scenario}\n")
    scenario = next(s for s in load_suite(str(drive_job.suite_folder)) if s.id == drive_job.scenario)
    error = float(len(drive_job.agent.name))
    return OpenLoopScenario(
        ap50=50.0, ade=error, fde=error, cr=0.0, cr_frames=0.0, cr_mdrive=0.0, overlap=0.0, frames=4, detections=2,
        truths=4, id=scenario.id, bucket=scenario.bucket, category=scenario.category, seed=drive_job.seed, skipped={},
        failures={}, digest="", precision_counts=((1.0, 2, 2),),
    )  # fmt: skip


def install(patch: pytest.MonkeyPatch) -> None:
    """Put the stand-ins in place: no worker processes, no drawing, and no checksum of all code for each run."""
    patch.setattr(ReportFigure, "render", lambda _, *kinds: tuple(b"<svg></svg>" for _ in kinds))
    for name in ("runs.fingerprint", "study.paper.study_folder"):
        patch.setattr(f"mdrive_sumo.{name}.compute_code_checksum", lambda: "sha256:code")
    for name, function, stand_in in (
        ("runs.evaluate", "run_job", drive),
        ("open_loop.evaluate_open", "run_open_loop_job", show),
    ):
        module = find_module(name)
        patch.setattr(module, function, stand_in)
        patch.setattr(module, "make_executor", LocalExecutor)


def find_module(name: str) -> ModuleType:
    """Return a module of the library whose package has a function of the same name."""
    return import_module(f"mdrive_sumo.{name}")
