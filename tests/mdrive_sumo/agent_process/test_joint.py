"""Joint agents: one program drives all CAVs; whatever it does ends its CAVs and nothing else."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from testing import carla_agents
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.agent_process.child_process import AgentProgram
from mdrive_sumo.agent_process.joint_agent import JointAgentSession
from mdrive_sumo.agent_process.remote_driver import AgentLimits, open_agent_connection
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import declare_agent, find_unknown_sensor, open_agents
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose

pytestmark = pytest.mark.slow

EGOS = ("b", "a")


def crew(path: Path, egos: tuple[str, ...] = EGOS) -> JointAgentSession:
    return JointAgentSession(
        open_agent_connection(AgentProgram(str(path), "carla"), AgentLimits(tick_s=20.0)),
        {"config": "config/my.yaml"},
        {ego: ego for ego in egos},
    )


def bends(name: str, start: tuple[float, float], signs: tuple[int, ...]) -> Ego:
    """A route of straights and quarter circles of 12 m, to the left where the sign is positive, from heading east."""
    xs, ys, yaws = [start[0]], [start[1]], [0.0]
    for turn in (0, *(part for sign in signs for part in (sign, 0))):
        for _ in range(19):
            yaws.append(yaws[-1] + turn / 12.0)
            middle = (yaws[-1] + yaws[-2]) / 2
            xs.append(xs[-1] + np.cos(middle))
            ys.append(ys[-1] + np.sin(middle))
    route = tuple(zip(map(float, xs), map(float, ys), yaws, strict=True))
    return Ego(id=name, start=Pose(x=start[0], y=start[1], yaw=0.0), lanes=("r_0",), route=route)


def drive(scenario: Scenario, one: JointAgentSession, clock: str = "ideal") -> EpisodeRecord:
    setting = EpisodeConfig(scenario, straight_road(), seed=0, options=EpisodeOptions(clock=parse_clock(clock)))
    try:
        return run_episode(setting, EmptyWorld(), one.drivers)
    finally:
        one.close()


@pytest.fixture
def two() -> Iterator[Scenario]:
    yield straight_scenario(straight_ego("b", x=10.0, length=25), straight_ego("a", x=10.0, length=15, y=40.0))


@pytest.mark.parametrize("clock", [pytest.param("ideal", marks=pytest.mark.full), "fixed:100"])
def test_an_agent_of_the_leaderboard_follows_its_routes_unchanged(tmp_path: Path, clock: str) -> None:
    """Left is left, north is north: nothing of this works if one sign is wrong."""
    scenario = straight_scenario(bends("left", (0.0, 0.0), (1, -1, -1)), bends("right", (5.0, -300.0), (-1, 1)))
    one = crew(carla_agents.write(tmp_path, carla_agents.FOLLOWER), ("left", "right"))
    episode = drive(scenario, one, clock)
    assert {ending.ego: ending.end for ending in episode.endings} == {"left": End.ARRIVED, "right": End.ARRIVED}
    assert one.usage_record()["answers"] > 100


def test_all_cavs_are_driven_by_one_program_until_they_end(tmp_path: Path, two: Scenario) -> None:
    one = crew(carla_agents.plain(tmp_path, "good"))
    assert {driver.label for driver in one.drivers.values()} == {"joint"}
    episode = drive(two, one)
    assert [ending.end for ending in episode.endings] == [End.ARRIVED, End.ARRIVED]
    assert episode.find_ending("a").tick < episode.find_ending("b").tick
    assert one.usage_record()["answers"] == episode.ticks - 1  # one request a tick


@pytest.mark.parametrize(
    ("mode", "failure", "text"),
    [
        ("setup", FailureReason.CRASHED, "OSError: no weights in config/my.yaml"),
        pytest.param("plan", FailureReason.CRASHED, "RuntimeError: too far", marks=pytest.mark.full),
        ("short", FailureReason.CRASHED, "TypeError: run_step(): expected a list of 2 controls, found 1"),
        pytest.param(
            "one",
            FailureReason.CRASHED,
            "TypeError: run_step(): expected a list of 2 controls, found VehicleControl; docs/carla-agents.md says"
            " how an agent for one vehicle is started",
            marks=pytest.mark.full,
        ),
        ("raise", FailureReason.CRASHED, "RuntimeError: lost"),
    ],
)
def test_the_failure_of_the_program_ends_all_cavs(
    tmp_path: Path, two: Scenario, mode: str, failure: FailureReason, text: str
) -> None:
    episode = drive(two, crew(carla_agents.plain(tmp_path, mode)))
    told = [(ending.end, ending.failure, ending.text) for ending in episode.endings]
    assert told == [(End.AGENT_FAILED, failure, text)] * 2
    assert len({ending.tick for ending in episode.endings}) == 1


@pytest.mark.parametrize(
    ("mode", "text"),
    [("none", "expected a Reply, found NoneType"), ("nan", "steer: expected a number in [-1, 1], found nan")],
)
def test_a_bad_control_ends_its_cav_only(tmp_path: Path, two: Scenario, mode: str, text: str) -> None:
    episode = drive(two, crew(carla_agents.plain(tmp_path, mode)))
    assert episode.find_ending("b").end is End.ARRIVED
    bad = episode.find_ending("a")
    assert (bad.end, bad.failure, bad.text, bad.failed_tick) == (End.AGENT_FAILED, FailureReason.INVALID, text, 3)


def test_a_dead_program_fails_every_call(tmp_path: Path) -> None:
    one = crew(carla_agents.plain(tmp_path, "setup"))
    for driver in one.drivers.values():
        for _ in range(2):
            with pytest.raises(AgentFailure, match="no weights"):
                driver.sensors()
    one.close()


def test_a_camera_is_refused_with_one_sentence(tmp_path: Path) -> None:
    path = carla_agents.write(tmp_path, carla_agents.CAMERA)
    sensors = declare_agent(AgentSpec(f"carla:{path}")).sensors
    assert re.match(
        r"sensor 'sensor\.camera\.dvs': expected .* found another name of a camera", find_unknown_sensor(sensors)
    )


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("x = 1", r"expected get_entry_point\(\) to name a class of the module, found none"),
        ("def get_entry_point(): return 'Nobody'", r"expected get_entry_point\(\) to name a class"),
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
    ],
)
def test_a_module_that_is_no_agent(tmp_path: Path, source: str, text: str) -> None:
    with pytest.raises(AgentFailure, match=text):
        declare_agent(AgentSpec(f"carla:{carla_agents.write(tmp_path, source)}"))


def test_a_folder_called_carla_is_no_carla(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "carla"
    folder.mkdir()
    monkeypatch.chdir(tmp_path)
    assert declare_agent(AgentSpec(f"carla:{carla_agents.plain(folder, 'good')}")).label == "joint"


def test_open_agents_starts_one_process_for_all_cavs(tmp_path: Path) -> None:
    path = carla_agents.plain(tmp_path, "good")
    spec = AgentSpec(f"carla:{path}")
    assert declare_agent(spec).label == "joint"
    with open_agents(spec, dict(zip(EGOS, EGOS, strict=True)), tmp_path / "s") as drivers:
        assert [[spec.kind for spec in driver.sensors()] for driver in drivers.values()] == [["speedometer"]] * 2
    assert (tmp_path / "s.all.log").is_file()
