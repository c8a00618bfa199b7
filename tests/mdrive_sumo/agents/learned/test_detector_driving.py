"""Agents behind detectors in closed loop: braking for what another car sees, channels, the command line."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.actors_world import actor
from testing.local_executor import run_in_process
from testing.sampling import sampled
from testing.short_suite import make_short_suite
from testing.tiny_detector import VAN_LAYERS, save_tiny_detector
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.agents.registry import AGENTS, DETECTOR_AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.contract import STANDSTILL, Agent, Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.state import End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.scoring import load_results
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.v2x.messages import FEATURE

pytestmark = pytest.mark.slow

VAN = actor("van", "vehicle", at=(45.0, 0.0)).model_copy(update={"length": 6.0, "width": 2.0})
SCENARIO = straight_scenario(
    straight_ego("0", x=10.0).model_copy(update={"time_limit_s": 9.0}), straight_ego("1", x=36.0, y=7.0)
).model_copy(update={"actors": (VAN,)})
SHORT = "i07_ins_ss_town"


class Parked:
    """Says what an agent says, and stands."""

    label = "sharing"

    def __init__(self, agent: Agent) -> None:
        self._agent = agent

    def sensors(self) -> tuple[SensorSpec, ...]:
        return self._agent.sensors()

    def start(self, briefing: Briefing) -> None:
        self._agent.start(briefing)

    def act(self, seen: Observation) -> Reply:
        return replace(self._agent.act(seen), plan=None, control=STANDSTILL)


def drive_to_van(weights: Path, comm: str) -> EpisodeRecord:
    """CAV "0" drives towards a van, which only the parked "1" makes out: the network ignores the own map."""
    config = EpisodeConfig(SCENARIO, straight_road(), seed=3, options=EpisodeOptions(comm=PRESETS[comm]))
    agents = [AGENTS["perception-swap:fcooper"]({"weights": str(weights)}) for _ in "01"]
    return run_episode(config, EmptyWorld(), {"0": LocalDriver(agents[0]), "1": LocalDriver(Parked(agents[1]))})


@pytest.mark.parametrize("comm", sampled(("ideal", "paper-latency", "its-g5", "off"), ("paper-latency", "off")))
def test_it_brakes_for_what_only_another_car_makes_out(tmp_path: Path, comm: str) -> None:
    record = drive_to_van(save_tiny_detector(tmp_path, "fcooper", uses_own=False, layers=VAN_LAYERS), comm)
    assert (len(record.contacts) == 0) is (comm != "off")
    assert not any(note.note.kind == "unreadable" for note in record.notes)
    assert {message.message.type for message in record.messages} >= {FEATURE}


def invoke(*words: str | Path | int) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.mark.parametrize(
    ("name", "label"), [("attfuse", "sharing"), ("early", "sharing"), ("late", "sharing"), ("none", "single")]
)
def test_a_run_arrives_with_its_labels_and_verifies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, label: str
) -> None:
    run_in_process(monkeypatch)
    weights = save_tiny_detector(tmp_path, "none" if name == "late" else name, layers=VAN_LAYERS)
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"weights": str(weights)}))
    suite = make_short_suite(tmp_path / "suite", SHORT, metres=8)
    ended = invoke("eval", "--suite", suite, "--agent", f"perception-swap:{name}", "--agent-config", config,
                   "--workers", 1, "--out", tmp_path / "run")  # fmt: skip
    assert ended.exit_code == 0, ended.output
    results = load_results(tmp_path / "run" / "results.json")
    assert {ego.outcome for ego in results.scenarios[0].egos} == {End.ARRIVED}
    assert results.run.labels == (label,) and results.run.sensing_track == "sensor"
    assert "onnxruntime" in results.run.versions
    verified = invoke("verify", tmp_path / "run", "--workers", 1)
    assert verified.exit_code == 0 and "1 of 1 scenarios are identical" in verified.stdout, verified.output


def test_new_weights_of_either_file_make_another_run(tmp_path: Path) -> None:
    from mdrive_sumo.runs.agent_spec import AgentSpec

    def identify(seed: int) -> str:
        weights = save_tiny_detector(tmp_path, "fcooper", encoder_seed=seed)
        return AgentSpec("perception-swap:fcooper", {"weights": str(weights)}).config_hash()

    assert identify(0) == identify(0) != identify(1)


@pytest.mark.parametrize("name", sorted(DETECTOR_AGENTS))
def test_missing_weights_end_the_command_with_one_sentence(tmp_path: Path, name: str) -> None:
    config = tmp_path / "config.json"
    file = "none" if name.endswith("late") else name.rpartition(":")[2]
    config.write_text(json.dumps({"weights": str(tmp_path / f"{file}.onnx")}))
    ended = invoke("eval", "--suite", "interdrive@0", "--scenario", SHORT, "--agent", name, "--agent-config", config)
    assert ended.exit_code == 2 and f"{file}-encoder.json: cannot be read" in ended.output
    assert "Traceback" not in ended.output
