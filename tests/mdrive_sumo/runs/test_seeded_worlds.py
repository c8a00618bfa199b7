"""A seed draws the world of a run: driving, scoring, verifying and showing it take the same scenario."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import mdrive_sumo as md
from mdrive_sumo.cli import main
from server.api.child_calls import ReplayRequest, write_replay_page

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]

SCENARIO = "i42_hw_merge_slip_road"


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seed") / "run"
    given = [
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        SCENARIO,
        "--agent",
        "constant-speed",
        "--seed",
        "1",
        "--workers",
        "1",
    ]
    assert call(*given, "--out", folder).exit_code == 0
    return folder


def call(*arguments: object) -> Any:
    return CliRunner().invoke(main, [str(one) for one in arguments])


def test_seeds_change_what_a_blind_agent_does() -> None:
    episodes = [md.simulate(SCENARIO, "constant-speed", seed=seed) for seed in (0, 1, 2)]
    assert len({episode.digest for episode in episodes}) == 3
    starts = [episode.record.x[0, : episode.record.egos].tolist() for episode in episodes]
    assert starts[0] == [round(ego.start.x, 3) for ego in episodes[0].scenario.as_written.egos]
    assert starts[1] != starts[0] != starts[2] != starts[1]


def test_everything_that_reads_a_run_takes_its_world(run_folder: Path, tmp_path: Path) -> None:
    results = json.loads((run_folder / "results.json").read_text())
    recorded = results["scenarios"][0]
    assert "identical" in call("verify", run_folder, "--workers", "1").output
    assert call("rescore", run_folder).exit_code == 0
    again = json.loads((run_folder / "results-mdrive.json").read_text())
    assert again["scenarios"] == results["scenarios"]
    loaded = md.load_episode(run_folder / "episodes" / f"{SCENARIO}.npz")
    assert json.loads(loaded.result.model_dump_json()) == recorded
    assert loaded.digest == md.simulate(SCENARIO, "constant-speed", seed=1).digest
    assert loaded.scenario != loaded.scenario.as_written
    page = tmp_path / "page.html"
    assert call("view", run_folder, "--scenario", SCENARIO, "--export", page).exit_code == 0
    theirs = tmp_path / "theirs.html"
    write_replay_page(
        ReplayRequest("interdrive", SCENARIO, recorded, run_folder / "episodes" / f"{SCENARIO}.npz", theirs)
    )
    assert theirs.read_text() == page.read_text() == loaded.replay().html
