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
from testing.tiny_detector import PERSON_LAYERS, VAN_LAYERS, save_tiny_detector
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.agents.registry import AGENTS, DETECTOR_AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.contract import STANDSTILL, Agent, Briefing, Cause, Observation, Reason, Reply, SensorSpec
from mdrive_sumo.core.state import End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scoring import load_results
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.v2x.messages import FEATURE

pytestmark = pytest.mark.slow

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


def drive(weights: Path, comm: str, scenario: Scenario, roads: RoadMap) -> EpisodeRecord:
    """CAV "0" drives, "1" is parked; both share features. The least certain boxes of the network count, too."""
    options = EpisodeOptions(comm=PRESETS[comm], sensing=SensingProfile.PERFECT)
    config = EpisodeConfig(scenario, roads, seed=3, options=options)
    agents = [AGENTS["perception-swap:fcooper"]({"weights": str(weights), "score": 0.1}) for _ in "01"]
    record = run_episode(config, EmptyWorld(), {"0": LocalDriver(agents[0]), "1": LocalDriver(Parked(agents[1]))})
    assert not any(note.note.kind == "unreadable" for note in record.notes)
    assert {message.message.type for message in record.messages} >= {FEATURE}
    return record


def make_scenario(parked_at: tuple[float, float], other: Actor, time_limit_s: float) -> Scenario:
    """CAV "0" shall drive 50 m east from x = 10; "1" is parked, and another road user stands somewhere."""
    driving = straight_ego("0", x=10.0).model_copy(update={"time_limit_s": time_limit_s})
    x, y = parked_at
    return straight_scenario(driving, straight_ego("1", x=x, y=y)).model_copy(update={"actors": (other,)})


@pytest.mark.parametrize("comm", sampled(("ideal", "paper-latency", "its-g5", "off"), ("paper-latency", "off")))
def test_it_stops_for_what_only_another_car_makes_out(tmp_path: Path, comm: str) -> None:
    """The network ignores the own map. "0" hits the van unless it gets the map of "1"."""
    van = actor("van", "vehicle", at=(45.0, 0.0)).model_copy(update={"length": 6.0, "width": 2.0})
    weights = save_tiny_detector(tmp_path, "fcooper", uses_own=False, layers=VAN_LAYERS)
    record = drive(weights, comm, make_scenario((36.0, 7.0), van, 9.0), straight_road())
    assert (len(record.contacts) == 0) is (comm != "off")


def wall(name: str, near_m: float, far_m: float) -> Building:
    return Building(id=name, polygon=((34.0, near_m), (41.0, near_m), (41.0, far_m), (34.0, far_m)))


def test_it_brakes_earlier_for_a_person_behind_a_wall_whom_another_car_sees(tmp_path: Path) -> None:
    """A gate 7 m deep and as wide as the car hides a person at its end, whom "1" sees from the other side."""
    roads = replace(straight_road(), buildings=(wall("right", -1.2, -12.0), wall("left", 1.2, 12.0)))
    scenario = make_scenario((50.0, 3.6), actor("walker", "pedestrian", at=(44.0, -2.2)), 7.0)
    weights = save_tiny_detector(tmp_path, "fcooper", layers=PERSON_LAYERS)

    def find_first_hazard(comm: str) -> float:
        """x [m] of "0" when it first brakes for a hazard."""
        record = drive(weights, comm, scenario, roads)
        assert len(record.contacts) == 0
        reasons = {note.tick: reason for note in record.notes if (reason := Reason.from_note(note.note)) is not None}
        tick = min(tick for tick, reason in reasons.items() if reason.cause is Cause.HAZARD)
        return float(record.quanta[tick, 0, 0]) / 1000.0

    told, alone = find_first_hazard("ideal"), find_first_hazard("off")
    assert 44.0 - told == pytest.approx(11.0, abs=1.5)  # 12 m at 6 m/s, to a box whose cell is up to 1.6 m off
    assert alone - told > 4.0


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
    file = getattr(AGENTS[name], "weights")  # noqa: B009 - the type of a factory has none
    config.write_text(json.dumps({"weights": str(tmp_path / f"{file}.onnx")}))
    ended = invoke("eval", "--suite", "interdrive@0", "--scenario", SHORT, "--agent", name, "--agent-config", config)
    assert ended.exit_code == 2 and f"{file}-encoder.json: cannot be read" in ended.output
    assert "Traceback" not in ended.output
