"""Participants begin with a sample that works, and `check` says what the server would say."""

import os
from pathlib import Path

import pytest
from testing.archive_samples import GOOD, declaring, packed, written
from testing.participant_fakes import Run, command_line
from testing.sandbox_runs import needs_bubblewrap

from server.archive import ArchiveLimits, ArchiveRefused, check_archive
from server.participant.packaging import write_archive as pack

JOINT = """
from leaderboard.autoagents.autonomous_agent import AutonomousAgent

def get_entry_point():
    return "Mine"

class Mine(AutonomousAgent):
    def sensors(self):
        return [{"type": "%s", "id": "x"}]
"""
boxed = needs_bubblewrap


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    monkeypatch.chdir(tmp_path)
    return command_line(monkeypatch)


def agent_in(folder: Path, agents: str) -> Path:
    return written(folder, packed(dict(GOOD) | {"agents.py": agents.encode()}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("style", "sensors"),
    [("agent", "objects"), ("joint", "lidar:lidar, gnss, imu, speedometer"), ("lidar", "lidar:top")],
)
def test_samples_are_accepted(run: Run, tmp_path: Path, style: str, sensors: str) -> None:
    made = run("init-agent", tmp_path / "mine", "--style", style)
    assert made.exit_code == 0, made.output
    found = run("check", tmp_path / "mine")
    assert found.exit_code == 0, found.output
    assert f"sensors      {sensors}\naccepted" in found.output
    assert "environment  python3.11-numpy" in found.output
    assert not list((tmp_path / "mine").rglob("__pycache__"))


def test_init_agent_overwrites_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "agents.py").write_text("precious")
    found = run("init-agent", tmp_path / "mine")
    assert found.exit_code == 2
    assert "expected an empty or new folder" in found.output
    assert (tmp_path / "mine" / "agents.py").read_text() == "precious"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("agents", "expected"),
    [
        (declaring('SensorSpec("privileged"),'), "found the privileged one, which is not allowed"),
        (declaring(label="privileged"), "found the privileged one, which is not allowed"),
        (declaring('SensorSpec("rgb"),'), "found another name of a camera"),
        (declaring('SensorSpec("radar"),'), "sensor 'radar': expected one of"),
        (JOINT % "sensor.camera.dvs", "found another name of a camera"),
        pytest.param(JOINT % "sensor.other.radar", "expected one of", marks=pytest.mark.full),
        pytest.param(declaring(label="best"), "label: expected one of", marks=pytest.mark.full),
        pytest.param(
            declaring(made="raise ValueError('no weights')"),
            "agent: cannot be created: ValueError: no weights",
            marks=pytest.mark.full,
        ),
        (
            "import nowhere\nclass Agent: ...",
            "agent: cannot be created: ModuleNotFoundError: No module named 'nowhere'",
        ),
        pytest.param(
            "Agent = 5",
            "agent: cannot be created: expected a class Agent in agents.py, found none",
            marks=pytest.mark.full,
        ),
        ("class Agent(:", "agent: cannot be created: SyntaxError"),
    ],
)
def test_what_is_rejected_is_told_in_a_sentence(run: Run, tmp_path: Path, agents: str, expected: str) -> None:
    found = run("check", agent_in(tmp_path, agents))
    assert found.exit_code == 2, found.output
    assert expected in found.output
    assert found.output.count("\nError: ") == 1
    assert "Traceback" not in found.output


@pytest.mark.slow
def test_the_agent_is_run_in_another_process(run: Run, tmp_path: Path) -> None:
    found = run("check", agent_in(tmp_path, declaring(made="raise ValueError(f'pid {os.getpid()}.')")))
    assert "ValueError: pid" in found.output
    assert f"pid {os.getpid()}." not in found.output


def test_a_bad_archive_is_refused_before_anything_is_run(run: Run, tmp_path: Path) -> None:
    path = written(tmp_path, b"PK nonsense")
    found = run("check", path)
    assert (found.exit_code, "found a damaged one" in found.output) == (2, True)
    assert run("check", tmp_path / "nothing").exit_code == 2


@boxed
@pytest.mark.slow
def test_in_the_sandbox_an_agent_sees_its_archive_and_nothing_else(run: Run, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("s")
    looks = f'raise ValueError(f\'{{sorted(os.listdir("/agent"))}} {{os.path.exists("{secret}")}}\')'
    found = run("check", agent_in(tmp_path, declaring(made=looks)), "--sandbox")
    assert "ValueError: ['agents.py', 'model_env.yaml'] False" in found.output
    assert "replaces python3.11-numpy; see --environments" in found.output


def test_an_environment_that_is_not_built_is_no_silent_other_one(run: Run, tmp_path: Path) -> None:
    found = run("check", agent_in(tmp_path, declaring()), "--environments", tmp_path)
    assert found.exit_code == 2
    assert "environment python3.11-numpy: not built in" in found.output


def test_the_same_folder_makes_the_same_archive(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    for name, data in {**GOOD, "src/a.py": b"a", "src/__pycache__/a.pyc": b"x", ".git/config": b"x"}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    pack(folder, tmp_path / "1.zip")
    os.utime(folder / "agents.py", (1, 1))
    pack(folder, tmp_path / "2.zip")
    assert (tmp_path / "1.zip").read_bytes() == (tmp_path / "2.zip").read_bytes()
    assert check_archive(tmp_path / "1.zip", ArchiveLimits()).files == 3


def test_links_are_not_packed(tmp_path: Path) -> None:
    (tmp_path / "weights").symlink_to("/etc")
    with pytest.raises(ArchiveRefused, match="symbolic link"):
        pack(tmp_path, tmp_path.parent / f"{tmp_path.name}.zip")


@pytest.mark.slow
def test_sensors_beyond_the_budget_are_named_before_anything_is_submitted(run: Run, tmp_path: Path) -> None:
    many = "*(SensorSpec('bev', id=str(i), options={'size': 1024}) for i in range(8)),"
    found = run("check", agent_in(tmp_path, declaring(many)))
    assert found.exit_code == 2
    assert "sensors: expected a price of at most 40 ms a tick for each car" in found.output
    assert "found 242.9 ms for 8 sensors" in found.output
