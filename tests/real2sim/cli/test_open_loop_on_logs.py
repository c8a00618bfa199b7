"""`eval-open --reference log` on a converted log: two CAVs, a station, 4 s in the V2XPnP format."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import run_in_process
from testing.recorded_drive_agent import RECORDED_DRIVE, register_recorded_drive

from mdrive_sumo.cli import main
from mdrive_sumo.episode import load_episode

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


@pytest.fixture(autouse=True)
def _in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)
    register_recorded_drive(monkeypatch)


def show(suite: Path, agent: str, out: Path, *more: object) -> Result:
    words = ("eval-open", "--suite", suite, "--reference", "log", "--agent", agent, "--workers", 1, "--out", out, *more)
    return CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)


def scores(out: Path) -> dict[str, float]:
    return json.loads((out / "open_loop.json").read_text())["overall"]


def test_what_the_log_did_has_no_error(suite: Path, tmp_path: Path) -> None:
    log = suite / "small" / "log.npz"
    episode = load_episode(log)
    assert dict(episode.about) == {"agent": "log", "source": "v2xpnp", "log": "small"}
    assert episode.ticks == 81
    (tmp_path / "own.json").write_text(json.dumps({"recording": str(log)}))
    own = show(suite, RECORDED_DRIVE, tmp_path / "own", "--agent-config", tmp_path / "own.json", "--ids", "scenario")
    assert own.exit_code == 0, own.output
    found = scores(tmp_path / "own")
    assert (found["ade"], found["fde"], found["ap50"], found["overlap"]) == (0.0, 0.0, 100.0, 0.0)
    assert found["frames"] == 2 * 6  # of 21 frames at 5 Hz those with 3 s to come, for both CAVs


def test_a_constant_speed_is_off_by_little(suite: Path, tmp_path: Path) -> None:
    """It plans 8 m/s where the logs drove 8 and 9, from a reference at most 1 m and 1.5 m/s off (`PathFollower`)."""
    shown = show(suite, "constant-speed", tmp_path / "constant")
    assert shown.exit_code == 0, shown.output
    assert 0.4 < scores(tmp_path / "constant")["ade"] < 2.6


def test_messages_arrive_between_the_frames(suite: Path, tmp_path: Path) -> None:
    """Without noise everything in sight is detected; what is hidden is known from messages only."""
    for agent in ("single", "sharing"):
        assert show(suite, agent, tmp_path / agent, "--sensing", "perfect").exit_code == 0
    assert 95.0 < scores(tmp_path / "single")["ap50"] < scores(tmp_path / "sharing")["ap50"]


def test_a_log_that_is_missing_damaged_or_of_another_scenario(suite: Path, tmp_path: Path) -> None:
    copy = tmp_path / "suite"
    shutil.copytree(suite, copy)
    log = copy / "small" / "log.npz"
    log.write_bytes(b"no archive")
    damaged = show(copy, "idm", tmp_path / "a")
    assert damaged.exit_code == 2 and f"{log}: expected a recording of mdrive-sumo, found a corrupt" in damaged.stderr
    log.unlink()
    missing = show(copy, "idm", tmp_path / "b")
    assert missing.exit_code == 2
    assert f"expected {log}, the log of small, found no file (1 of 1 scenarios have none)" in missing.stderr
    text = (suite / "small" / "scenario.json").read_text()
    renamed = tmp_path / "renamed"  # another folder: a worker loads a suite once
    shutil.copytree(suite, renamed)
    (renamed / "small").rename(renamed / "other")
    (renamed / "other" / "scenario.json").write_text(text.replace('"id":"small"', '"id":"other"', 1))
    other = show(renamed, "idm", tmp_path / "c")
    assert other.exit_code == 2 and "expected a recording of other, found one of 'small'" in other.stderr
