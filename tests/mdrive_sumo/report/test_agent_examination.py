"""`doctor --agent`: what of an agent cannot be had here."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing import carla_agents

from mdrive_sumo.cli.doctor import command
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.agent_examination import _examine_imports, find_agent

MISSING = """
import json
import carla
import no_such_package.inner
from leaderboard.autoagents.autonomous_agent import AutonomousAgent, Track
from leaderboard.autoagents import autonomous_agent
from leaderboard.utils.route_manipulation import downsample_route
from beside import something
from . import relative
try:
    import no_such_accelerator
except ImportError:
    pass

def connect():
    return carla.Client("localhost", 2000), carla.Location(0.0, 0.0, 0.0)
"""


def find_missing(folder: Path, source: str, *, is_carla: bool = True) -> list[str]:
    (folder / "beside.py").touch()
    findings = _examine_imports(carla_agents.write(folder, source), is_carla=is_carla)
    return [one.what for one in findings if not one.is_found]


def test_names_of_carla_and_packages_that_are_missing_are_listed(tmp_path: Path) -> None:
    expected = [
        "import leaderboard.utils.route_manipulation",
        "import no_such_package.inner",
        "carla.Client",
        "imports",
    ]
    assert find_missing(tmp_path, MISSING) == expected


def test_an_agent_of_mdrive_has_no_stubs_of_carla(tmp_path: Path) -> None:
    assert find_missing(tmp_path, "import carla\nimport numpy\n", is_carla=False) == ["import carla", "imports"]


def test_a_file_that_is_no_python_is_a_finding(tmp_path: Path) -> None:
    assert find_missing(tmp_path, "def") == ["file"]


@pytest.mark.parametrize(
    ("source", "ending", "locator"),
    [
        (carla_agents.SINGLE, "", "carla-single:{}"),
        (carla_agents.FOLLOWER, "", "carla:{}"),
        ("class Mine:\n    def act(self, seen): ...\nclass Helper: ...\n", "", "{}:Mine"),
        ("class Mine: ...\nclass Other: ...\n", ":Other", "{}:Other"),
    ],
)
def test_a_file_is_enough_if_it_has_one_agent(tmp_path: Path, source: str, ending: str, locator: str) -> None:
    path = carla_agents.write(tmp_path, source)
    assert find_agent(f"{path}{ending}").name == locator.format(path)


def test_who_leaves_the_choice_open_gets_a_sentence(tmp_path: Path) -> None:
    path = carla_agents.write(tmp_path, "class Mine: ...\nclass Other: ...\n")
    with pytest.raises(InputError, match=rf"use {path}:Mine or {path}:Other"):
        find_agent(str(path))
    with pytest.raises(InputError, match=r"found no file 'nowhere\.py'"):
        find_agent("nowhere.py")


@pytest.mark.slow
def test_sensors_are_listed_by_their_ids_with_what_replaces_them(tmp_path: Path) -> None:
    path = carla_agents.write(tmp_path, carla_agents.SINGLE.replace("sensor.speedometer", "sensor.other.radar"))
    result = CliRunner().invoke(command, ["--agent", str(path)])
    assert result.exit_code == 1
    found = {re.split(r"  +", line)[0] for line in result.output.splitlines() if "  yes" in line}
    assert {"sensor gnss", "sensor imu", "creation"} <= found
    assert "sensor 'speed' (sensor.other.radar)  NO    no radar here; LiDAR and cameras see" in result.output


def test_a_built_in_agent_lacks_nothing() -> None:
    result = CliRunner().invoke(command, ["--agent", "idm"])
    assert result.exit_code == 0, result.output
    assert "NO" not in result.output


def test_one_thing_is_examined_at_a_time() -> None:
    result = CliRunner().invoke(command, ["--agent", "idm", "--sandbox"])
    assert isinstance(result.exception, InputError)
