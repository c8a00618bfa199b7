"""Learned agents in closed loop, with rendered images: they arrive, in this process and in others, and runs verify."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.camera_scenes import needs_opengl
from testing.local_executor import run_in_process
from testing.short_suite import make_short_suite
from testing.tiny_network import TinyNetwork, save_tiny_weights

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.registry import LEARNED_AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import load_results

pytestmark = [pytest.mark.slow, needs_opengl]

SCENARIO = "i07_ins_ss_town"
METRES = 8


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def evaluate(folder: Path, agent: str, system: str, network: TinyNetwork) -> Result:
    """Drive a scenario of `METRES` with weights of a tiny network; results are in `folder`/run."""
    weights = save_tiny_weights(folder, SYSTEMS[system], network)
    config = folder / "config.json"
    config.write_text(json.dumps({"weights": str(weights)}))
    suite = make_short_suite(folder / "suite", SCENARIO, metres=METRES)
    return invoke("eval", "--suite", suite, "--agent", agent, "--agent-config", config, "--workers", 1, "--out",
                  folder / "run")  # fmt: skip


@pytest.mark.parametrize("name", LEARNED_AGENTS)
def test_it_arrives_and_the_run_verifies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    run_in_process(monkeypatch)
    ended = evaluate(tmp_path, name, name, TinyNetwork(speed=5.0, ahead_per_grey=0.002))
    assert ended.exit_code == 0, ended.output
    results = load_results(tmp_path / "run" / "results.json")
    assert {ego.outcome for ego in results.scenarios[0].egos} == {End.ARRIVED}
    assert results.run.labels == ("single",) and results.run.sensing_track == "sensor"
    verified = invoke("verify", tmp_path / "run", "--workers", 1)
    assert verified.exit_code == 0 and "1 of 1 scenarios are identical" in verified.stdout, verified.output


def test_it_drives_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)
    locator = "mdrive_sumo.agents.learned.learned_agent:VadAgent"
    ended = evaluate(tmp_path, locator, "vad", TinyNetwork(speed=5.0))
    assert ended.exit_code == 0, ended.output
    results = load_results(tmp_path / "run" / "results.json")
    assert {ego.outcome for ego in results.scenarios[0].egos} == {End.ARRIVED}


@pytest.mark.parametrize("name", LEARNED_AGENTS)
def test_packaged_weights_follow_the_route(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    run_in_process(monkeypatch)
    suite = make_short_suite(tmp_path / "suite", SCENARIO, metres=METRES)
    ended = invoke("eval", "--suite", suite, "--agent", name, "--workers", 1, "--out", tmp_path / "run")
    assert ended.exit_code == 0, ended.output
    assert load_results(tmp_path / "run" / "results.json").scenarios[0].rc == 100.0


def test_damaged_weights_end_the_command_with_one_sentence(tmp_path: Path) -> None:
    weights = save_tiny_weights(tmp_path, SYSTEMS["tcp"])
    weights.write_bytes(b"damaged")
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"weights": str(weights)}))
    ended = invoke(
        "eval", "--suite", "interdrive@0", "--scenario", SCENARIO, "--agent", "tcp", "--agent-config", config
    )
    assert ended.exit_code == 2 and "its manifest, found" in ended.output and "Traceback" not in ended.output
