"""Results made by hand, and the command line: shared by tests of studies. No tests in here."""

from pathlib import Path

from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
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
