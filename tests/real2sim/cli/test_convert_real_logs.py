"""`mdrive-sumo convert` for real logs: converted, driven, summarised."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.convert_command import run

from mdrive_sumo.cli import main
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scenario.suite import load_suite

pytestmark = pytest.mark.slow

LOGS = Path("real_logs")


@pytest.mark.usefixtures("in_process")
def test_a_real_log(shared_data: Path, tmp_path: Path) -> None:
    done = run(
        "commonroad", shared_data / LOGS / "commonroad/USA_US101-3_3_T-1.xml", "--out", tmp_path / "suite", "--report"
    )
    assert done.exit_code in (0, 1), done.output
    (scenario,) = load_suite(str(tmp_path / "suite")).scenarios
    assert run_job(EpisodeJob(tmp_path / "suite", scenario.id, AgentSpec("idm"))).status == "ok"
    assert run("--summary", tmp_path / "suite").exit_code == done.exit_code


@pytest.mark.full
@pytest.mark.parametrize(
    ("source", "path", "more"),
    [
        ("scenarionet", "scenarionet_nuscenes", ()),
        ("commonroad", "commonroad", ()),
        ("argoverse2", "argoverse2/forecasting", ()),
        ("argoverse2", "argoverse2/sensor", ()),
        ("interaction", "interaction", ("--window", "0,40", "--every", "20")),
    ],
)
def test_real_logs(source: str, path: str, more: tuple[str, ...], shared_data: Path, tmp_path: Path) -> None:
    done = run(source, shared_data / LOGS / path, "--out", tmp_path / "suite", "--report", *more)
    assert done.exit_code in (0, 1), done.output
    driven = CliRunner().invoke(
        main, ["eval", "--suite", str(tmp_path / "suite"), "--agent", "idm", "--out", str(tmp_path / "run")]
    )
    assert driven.exit_code == 0, driven.output
    assert run("--summary", tmp_path / "suite").exit_code == done.exit_code
