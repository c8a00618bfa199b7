"""Results made by hand, and the command line: shared by tests of studies. No tests in here."""

from collections.abc import Sequence
from pathlib import Path

from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.open_loop import OpenLoopResults, OpenLoopScenario
from mdrive_sumo.open_loop.results import OpenLoopRunInfo, summarize_open_loop
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, summarize_run
from mdrive_sumo.study.conditions import (
    ChannelCondition,
)
from mdrive_sumo.study.study_runs import StudyRow
from mdrive_sumo.v2x.comm_settings import PRESETS

IDEAL, OFF = PRESETS["ideal"], PRESETS["off"]


def make_scenario(name: str, ds: float, seed: int = 0, **other: object) -> ScenarioResult:
    values = {
        "id": name,
        "bucket": "InterDrive",
        "category": "ins_c",
        "seed": seed,
        "status": "ok",
        "reason": "",
        "ds": ds,
        "sr": ds,
        "rc": ds,
        "ip": 1.0,
        "min_ttc": None,
        "digest": "",
        "ticks": 1,
        "egos": [],
    }
    return ScenarioResult.model_validate(values | other)


def make_run(*scenarios: ScenarioResult, **facts: object) -> Results:
    about = {
        "agent": "talker",
        "suite": "interdrive",
        "suite_checksum": "sha256:0",
        "seed": scenarios[0].seed,
        "score_mode": "mdrive",
        "versions": {},
    }
    return summarize_run(RunInfo.model_validate(about | facts), scenarios)


def make_row(agent: str, condition: ChannelCondition, *scenarios: ScenarioResult, reused: bool = False) -> StudyRow:
    return StudyRow(agent, condition, (make_run(*scenarios, agent=agent),), reused)


def invoke(*given: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in given])


Precision = tuple[tuple[float, int, int], ...] | None


def make_recording(name: str, ade: float | None, precision: Precision = None, frames: int = 10) -> OpenLoopScenario:
    known = ade is not None
    return OpenLoopScenario(
        ap50=None,
        ade=ade,
        fde=2 * ade if known else None,
        cr=100.0 * (ade > 1) if known else None,
        cr_frames=ade,
        cr_mdrive=ade,
        overlap=ade,
        frames=frames if known else 0,
        detections=sum(row[2] for row in precision or ()),
        truths=20 if precision is not None else 0,
        id=name,
        bucket="V2XPnP",
        category="synthetic",
        seed=0,
        skipped={},
        failures={},
        digest="",
        precision_counts=precision,
    )


def make_open_run(agent: str, recordings: Sequence[OpenLoopScenario]) -> OpenLoopResults:
    info = OpenLoopRunInfo(
        agent=agent, agent_config="", suite="s", suite_checksum="", seeds=(0,), reference="omniscient",
        versions={}, options={},
    )  # fmt: skip
    return summarize_open_loop(info, recordings)
