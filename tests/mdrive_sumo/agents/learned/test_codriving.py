"""`codriving` and its twins: what is asked and sent, what a hidden car changes, noise, bad input, runs."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.actors_world import actor
from testing.lidar_scans import scan, sensor, town
from testing.local_executor import run_in_process
from testing.planning import briefing
from testing.sampling import sampled
from testing.short_suite import make_short_suite
from testing.tiny_detector import VAN_LAYERS, save_tiny_detector
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.agents.learned.codriving import CAP, CoDrivingAgent
from mdrive_sumo.agents.learned.detector_agent import OPTIONS
from mdrive_sumo.agents.learned.driving_request import REQUEST_GRID
from mdrive_sumo.agents.learned.fusion_spec import MAP_TICKS
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli import main
from mdrive_sumo.contract import (
    STANDSTILL,
    Agent,
    Briefing,
    Message,
    Observation,
    OwnState,
    Reply,
    SensorSpec,
    check_reply,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, Kind
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.scoring import load_results
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.v2x.messages import CAM, FEATURE, Feature, decode, encode
from mdrive_sumo.vehicle.control import CONTROLLERS

ROADS = town(((8.0, -8.0), (40.0, -8.0), (40.0, -6.0), (8.0, -6.0)))
"""A wall to the right of the own road."""
HIDDEN = (Kind.VEHICLE, 25.0, -12.0, 0.0, 4.5, 2.0)
POSES = {"a": (0.0, 0.0, 0.0), "b": (25.0, -30.0, math.pi / 2)}
"""The own car, and a sender that looks north to the hidden car."""
SCANS = {
    car: scan(sensor(ROADS, profile="lmdrive"), HIDDEN, own=(Kind.VEHICLE, *pose, 4.9, 2.1))
    for car, pose in POSES.items()
}
Change = Callable[[Sequence[Message]], Sequence[Message]]
TWINS = {"codriving": "codriving:alone", "codriving:fast": "codriving:fast-alone"}


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(save_tiny_detector(tmp_path_factory.mktemp("weights"), "codriving"))


def make_agent(weights: str, name: str = "codriving", **config: float) -> CoDrivingAgent:
    agent = AGENTS[name]({"weights": weights, **config})
    assert isinstance(agent, CoDrivingAgent)
    agent.start(briefing())
    return agent


def drive(agents: dict[str, CoDrivingAgent], ticks: int = 9, change: Change = lambda sent: sent) -> list[Reply]:
    """The replies of "a"; messages arrive a tick later, those of "b" changed."""
    replies: list[Reply] = []
    said: dict[str, Sequence[Message]] = {"a": (), "b": ()}
    for tick in range(ticks):
        now: dict[str, Sequence[Message]] = {}
        for car, agent in agents.items():
            heard = change(said["b"]) if car == "a" else said["a"]
            clouds = {} if tick % MAP_TICKS else {"top": SCANS[car]}
            own = OwnState(*POSES[car], 0.0, 0.0, 0.0, 0.0)
            reply = agent.act(Observation(tick, own, lidar=clouds, messages=tuple(heard)))
            check_reply(reply, frozenset(CONTROLLERS))
            now[car] = [replace(message, sender=car, tick=tick) for message in reply.messages]
            if car == "a":
                replies.append(reply)
        said = said | now
    return replies


def list_features(messages: Sequence[Message]) -> list[Feature]:
    contents = [decode(message) for message in messages if message.type == FEATURE]
    return [content for content in contents if isinstance(content, Feature)]


def expect_at_hidden(agent: CoDrivingAgent) -> float:
    """How likely the forecast of "a" takes the place of the hidden car to be occupied after 1 s."""
    forecast = agent._planner._forecast
    assert forecast is not None
    x, y = HIDDEN[1:3]
    near = np.array([[[x + i, y + j] for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0)]])
    return float(forecast.look_up(near, np.ones(1), forecast.tick).max())


def test_a_hidden_car_is_forecast_if_another_sends_what_it_is_asked_for(weights: str) -> None:
    agents = {car: make_agent(weights) for car in POSES}
    drive(agents)
    assert expect_at_hidden(agents["a"]) > 0.5
    drive(agents | {"a": (deaf := make_agent(weights))}, change=lambda sent: ())
    assert expect_at_hidden(deaf) == 0.0


def test_only_asked_tiles_are_sent_and_without_a_request_none(weights: str) -> None:
    agents = {car: make_agent(weights) for car in POSES}
    sent: list[list[Feature]] = []

    def keep(messages: Sequence[Message]) -> Sequence[Message]:
        sent.append(list_features(messages))
        return messages

    drive(agents, 6, keep)
    first, later = sent[1], sent[5]  # of the scans at ticks 0 and 4
    assert [one.grid for one in first] == [REQUEST_GRID]
    assert {one.grid.name for one in later} == {"request", "codriving"}

    def refuse(messages: Sequence[Message]) -> Sequence[Message]:
        """Another car asks for nothing: its requests are lost."""
        return [one for one in messages if one.type == CAM]

    alone = make_agent(weights)
    replies = drive({"a": alone, "b": make_agent(weights)}, 9, refuse)
    grids = {one.grid.name for reply in replies for one in list_features(reply.messages)}
    assert grids == {"request"}


@pytest.mark.parametrize("budget", [300, 1400, OPTIONS["budget"].default])
def test_messages_keep_to_the_budget(weights: str, budget: float) -> None:
    replies = drive({car: make_agent(weights, budget=budget) for car in POSES})
    sizes = [sum(len(m.payload) for m in reply.messages if m.type == FEATURE) for reply in replies]
    assert 0 < max(sizes) <= budget
    assert [tick for tick, size in enumerate(sizes) if size] == [0, MAP_TICKS, 2 * MAP_TICKS]
    assert OPTIONS["budget"].default * 8 * 5 < 2e6  # bit/s at 5 Hz


@pytest.mark.parametrize(("name", "twin"), TWINS.items())
def test_a_twin_neither_sends_nor_reads(weights: str, name: str, twin: str) -> None:
    shares, alone = make_agent(weights, name), make_agent(weights, twin)
    assert shares.label == "sharing" and alone.label == "single" and shares.cap == alone.cap
    replies = drive({"a": alone, "b": make_agent(weights, name)})
    assert all(reply.messages == () for reply in replies) and expect_at_hidden(alone) == 0.0
    with pytest.raises(InputError, match=rf"agent {twin}: expected options among .*, found 'budget'"):
        AGENTS[twin]({"weights": weights, "budget": 500.0})


def shout(sent: Sequence[Message]) -> list[Message]:
    """The same packets with the largest values there are, of either sign."""
    loud: list[Message] = []
    for message in sent:
        content = decode(message)
        if isinstance(content, Feature):
            places = content.places[:200]
            levels, steps = np.where(places % 2, 255, -255), np.full(content.grid.channels, 65504.0)
            noise = encode(replace(content, steps=steps, places=places, levels=levels))
            message = replace(noise, sender="b", tick=message.tick)
        loud.append(message)
    return loud


def garble(sent: Sequence[Message]) -> list[Message]:
    random = np.random.default_rng(5)
    return [replace(one, payload=random.bytes(len(one.payload))) for one in sent]


@pytest.mark.parametrize("change", [shout, garble])
def test_a_sender_of_noise_breaks_nothing(weights: str, change: Change) -> None:
    replies = drive({car: make_agent(weights) for car in POSES}, change=change)
    plan = replies[-1].plan
    assert plan is not None and np.isfinite(plan.points).all()
    notes = [note.text for reply in replies for note in reply.notes if note.kind == "unreadable"]
    assert bool(notes) is (change is garble)


def test_tiles_of_other_weights_are_not_used_and_said_once(weights: str, tmp_path: Path) -> None:
    other = str(save_tiny_detector(tmp_path, "codriving", encoder_seed=1))
    agent = make_agent(weights)
    replies = drive({"a": agent, "b": make_agent(other)})
    notes = [note.text for reply in replies for note in reply.notes if note.kind == "unreadable"]
    assert len(notes) == 1 and "expected the grid codriving version" in notes[0] and "request" not in notes[0]
    assert expect_at_hidden(agent) == 0.0


def test_weights_without_a_forecast_are_refused(tmp_path: Path) -> None:
    file = save_tiny_detector(tmp_path, "attfuse")
    for part in ("attfuse", "attfuse-encoder"):
        for end in (".onnx", ".json"):
            path = tmp_path / f"{part}{end}"
            content = path.read_bytes().replace(b'"attfuse', b'"codriving') if end == ".json" else path.read_bytes()
            path.with_name(path.name.replace("attfuse", "codriving")).write_bytes(content)
    with pytest.raises(InputError, match=r"codriving.onnx: input 'tracks': expected float32 \[6, 128, 128\]") as caught:
        AGENTS["codriving"]({"weights": str(file).replace("attfuse", "codriving")})
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"option weights: expected the path of codriving\.onnx or codriving\.json"):
        AGENTS["codriving:alone"]({"weights": str(file)})


VAN = actor("van", "vehicle", at=(45.0, 0.0)).model_copy(update={"length": 6.0, "width": 2.0})
SCENARIO = straight_scenario(
    straight_ego("0", x=10.0).model_copy(update={"time_limit_s": 7.5}), straight_ego("1", x=36.0, y=7.0)
).model_copy(update={"actors": (VAN,)})


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
    agents = [AGENTS["codriving:fast"]({"weights": str(weights)}) for _ in "01"]
    return run_episode(config, EmptyWorld(), {"0": LocalDriver(agents[0]), "1": LocalDriver(Parked(agents[1]))})


@pytest.mark.slow
@pytest.mark.parametrize("comm", sampled(("ideal", "realistic", "its-g5", "off"), ("realistic", "off")))
def test_it_stops_for_what_only_another_car_makes_out(tmp_path: Path, comm: str) -> None:
    weights = save_tiny_detector(tmp_path, "codriving", uses_own=False, layers=VAN_LAYERS)
    record = drive_to_van(weights, comm)
    assert (len(record.contacts) == 0) is (comm != "off")
    assert not any(note.note.kind == "unreadable" for note in record.notes)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "label"), [("codriving", "sharing"), ("codriving:alone", "single")])
def test_a_run_arrives_below_the_cap_with_its_labels_and_verifies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, label: str
) -> None:
    run_in_process(monkeypatch)
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"weights": str(save_tiny_detector(tmp_path, "codriving", layers=VAN_LAYERS))}))
    suite = make_short_suite(tmp_path / "suite", "i07_ins_ss_town", metres=12)
    words = ["eval", "--suite", suite, "--agent", name, "--agent-config", config, "--workers", 1]
    ended = CliRunner().invoke(main, [str(word) for word in (*words, "--out", tmp_path / "run")])
    assert ended.exit_code == 0, ended.output
    results = load_results(tmp_path / "run" / "results.json")
    assert {ego.outcome for ego in results.scenarios[0].egos} == {End.ARRIVED}
    assert results.run.labels == (label,) and results.run.sensing_track == "sensor"
    (path,) = (tmp_path / "run" / "episodes").glob("*.npz")
    episode = load_episode(path)
    assert 4.0 < np.nanmax(episode.speed[:, : episode.egos]) < 1.2 * CAP  # the controller overshoots
    verified = CliRunner().invoke(main, ["verify", str(tmp_path / "run"), "--workers", "1"])
    assert verified.exit_code == 0 and "1 of 1 scenarios are identical" in verified.stdout, verified.output
