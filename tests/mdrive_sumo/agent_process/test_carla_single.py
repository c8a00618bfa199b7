"""Agents of the CARLA leaderboard for one vehicle: recognised by their files, one instance for each CAV."""

from pathlib import Path

import pytest
from testing import carla_agents
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.agent_process.agent_file import describe_missing_class, drives_one_vehicle
from mdrive_sumo.agent_process.carla_adapter import SensorReadings, _create_agent
from mdrive_sumo.agent_process.carla_stubs import AutonomousAgent, Location, RoadOption, Transform, call_setup
from mdrive_sumo.core.state import End
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import declare_agent, find_unknown_sensor, open_agents
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.verify import _shorten_locator

ENTRY = "def get_entry_point():\n    return 'Mine'\n"


@pytest.mark.parametrize(
    ("source", "single"),
    [
        (carla_agents.SINGLE, True),
        (carla_agents.FOLLOWER, False),
        (carla_agents.PLAIN, False),
        (carla_agents.CAMERA, False),  # the base class says nothing
        (ENTRY + "class Mine:\n    def setup(self, path, route_index=None, traffic_manager=None): ...\n", True),
        (ENTRY + "class Mine:\n    def setup(self, path, ego_vehicles_num=1): ...\n", False),
        (ENTRY + "class Mine:\n    def setup(self, *args): ...\n", False),
        (ENTRY + "class Mine:\n    def setup(self, path, **more): ...\n", True),
        (ENTRY + "class Base:\n    def setup(self, path): ...\nclass Mine(Base): ...\n", True),
        (ENTRY + "class Mine(Mine): ...\n", False),
        (ENTRY + "from team_code.base import Base as B\nclass Mine(B): ...\n", True),
        (ENTRY + "from elsewhere.base import Base\nclass Mine(Base): ...\n", False),
        ("def get_entry_point():\n    return NAME\nclass Mine:\n    def setup(self, path): ...\n", False),
        ("class Mine:\n    def setup(self, path): ...\n", False),
        ("this is no Python", False),
    ],
)
def test_setup_says_how_many_vehicles_an_agent_drives(tmp_path: Path, source: str, single: bool) -> None:
    (tmp_path / "team_code").mkdir()
    (tmp_path / "team_code" / "base.py").write_text("class Base:\n    def setup(self, path): ...\n")
    path = carla_agents.write(tmp_path, source)
    assert drives_one_vehicle(path) is single
    kind = "carla-single" if single else "carla"
    spec = AgentSpec(f"carla:{path}").resolve()
    assert spec.name == f"{kind}:{path}"
    assert spec.resolve() == spec
    assert RunConfig.from_dict(RunConfig(agent=spec).to_dict()).agent == spec


def test_a_missing_file_is_no_agent_for_one_vehicle(tmp_path: Path) -> None:
    assert not drives_one_vehicle(tmp_path / "none.py")


def test_who_names_only_the_file_is_told_what_to_type(tmp_path: Path) -> None:
    path = carla_agents.write(tmp_path, carla_agents.SINGLE)
    assert describe_missing_class(path) == f"found an agent of the CARLA leaderboard; use carla:{path}"


@pytest.mark.slow
def test_every_cav_gets_an_instance_of_an_unchanged_agent(tmp_path: Path) -> None:
    scenario = straight_scenario(straight_ego("b", x=10.0, length=25), straight_ego("a", x=10.0, length=15, y=40.0))
    spec = AgentSpec(f"carla:{carla_agents.write(tmp_path, carla_agents.SINGLE)}").resolve()
    setting = EpisodeConfig(scenario, straight_road(), seed=0)
    with open_agents(spec, {"b": "1", "a": "2"}, tmp_path / "s") as drivers:
        assert {driver.label for driver in drivers.values()} == {"single"}
        episode = run_episode(setting, EmptyWorld(), drivers)
    assert {ending.ego: ending.end for ending in episode.endings} == {"a": End.ARRIVED, "b": End.ARRIVED}
    assert sorted(path.name for path in tmp_path.glob("s.*")) == ["s.a.log", "s.b.log"]


@pytest.mark.slow
def test_its_declaration_names_a_sensor_that_does_not_exist(tmp_path: Path) -> None:
    source = carla_agents.SINGLE.replace("sensor.speedometer", "sensor.other.radar")
    spec = AgentSpec(f"carla:{carla_agents.write(tmp_path, source)}").resolve()
    declared = declare_agent(spec)
    assert declared.label == "single"
    text = find_unknown_sensor(declared.sensors)
    assert text.startswith("sensor 'sensor.other.radar': expected one of ")
    assert text.endswith("(id 'speed')")


def test_asking_for_another_sensor_names_those_that_there_are() -> None:
    readings = SensorReadings(gps_0=(3, None), imu_0=(3, None))
    with pytest.raises(KeyError, match=r"gps: expected a sensor of this tick \(gps_0, imu_0\), found no such sensor"):
        readings["gps"]
    assert readings.get("gps") is None
    assert "gps" not in readings


class Told:
    told: object = None


class Setup(Told):
    def setup(self, path: str) -> None:
        self.told = path


class OptionalSetup(Told):
    def setup(self, path: str, route_index: int | None = None) -> None:
        self.told = path if route_index is None else route_index


class Constructed(Told):
    def __init__(self, path: str) -> None:
        self.told = path


class SecondLeaderboard(Setup):
    def __init__(self, carla_host: str, carla_port: int, debug: bool = False) -> None:
        assert (carla_host, carla_port, debug) == ("localhost", 2000, False)


class FirstLeaderboard(AutonomousAgent):
    def setup(self, path_to_conf_file: str) -> None:  # pyright: ignore[reportIncompatibleMethodOverride] - as theirs
        self.told = path_to_conf_file


@pytest.mark.parametrize("cls", [Setup, OptionalSetup, Constructed, SecondLeaderboard, FirstLeaderboard])
def test_the_constructors_of_both_leaderboards_are_called(cls: type[object]) -> None:
    assert _create_agent(cls, "my.yaml", 1, is_single=True).told == "my.yaml"


def test_the_base_class_keeps_the_plan_of_one_vehicle() -> None:
    world = [(Transform(Location(float(x), 0.0, 0.0)), RoadOption.LANEFOLLOW) for x in range(120)]
    agent = AutonomousAgent("x")
    agent.set_global_plan([({"lat": float(x)}, option) for x, (_, option) in enumerate(world)], world)
    assert [place.location.x for place, _ in agent._global_plan_world_coord] == [0.0, 50.0, 100.0, 119.0]
    assert [point["lat"] for point, _ in agent._global_plan] == [0.0, 50.0, 100.0, 119.0]


def test_setup_gets_the_number_of_vehicles_only_if_it_asks_for_it() -> None:
    told: list[tuple[object, ...]] = []

    class Mine:
        def setup(self, path: str, route: object = None) -> None:
            told.append((path, route))

    class Joint:
        def setup(self, path: str, ego_num: int) -> None:
            told.append((path, ego_num))

    call_setup(Mine(), "a", 3)
    call_setup(Joint(), "b", 3)
    assert told == [("a", None), ("b", 3)]


def test_results_name_the_agent_as_it_was_typed() -> None:
    assert _shorten_locator("carla:mine.py") == _shorten_locator("carla-single:/home/me/mine.py") == "mine.py"
    assert _shorten_locator("mine.py:Mine") == _shorten_locator("/home/me/mine.py:Mine")
