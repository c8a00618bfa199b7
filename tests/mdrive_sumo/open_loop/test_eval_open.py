"""`mdrive-sumo eval-open` from the command to the file, on a run of a few seconds."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import run_in_process
from testing.short_suite import make_short_suite

from mdrive_sumo.cli import main
from mdrive_sumo.episode import load_episode, rebuild_frame

AGENT = '''
from mdrive_sumo.contract import Plan, Reply, SensorSpec
import numpy as np

class Still:
    """Plans to stand, and fails when its car is fast."""
    label = "single"

    def __init__(self, config):
        self._most = config.get("most", 1e9)

    def sensors(self):
        return (SensorSpec("objects"),)

    def start(self, briefing):
        pass

    def act(self, seen):
        if seen.own.speed > self._most:
            raise ValueError("too fast")
        return Reply(plan=Plan(np.tile((seen.own.x, seen.own.y), (15, 1)), 0.2))
'''


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(one) for one in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of `single`, 60 m long."""
    folder = tmp_path_factory.mktemp("open")
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        suite = make_short_suite(folder / "suite", "i11_ins_sl_town", metres=60)
        done = run("eval", "--suite", suite, "--agent", "single", "--out", folder / "run", "--workers", "1")
    assert done.exit_code == 0, done.output
    return folder / "run"


@pytest.fixture(autouse=True)
def _in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)


def test_the_agent_of_the_reference_plans_nearly_what_it_drove(reference: Path, tmp_path: Path) -> None:
    done = run("eval-open", "--reference", reference, "--agent", "single", "--out", tmp_path / "a", "--workers", "1")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "a" / "open_loop.json").read_text())["overall"]
    assert found["frames"] > 20
    assert found["ade"] < 2.0 and found["ade"] < found["fde"]
    assert 0.0 < found["ap50"] <= 100.0
    again = run("eval-open", "--reference", reference, "--agent", "single", "--out", tmp_path / "a", "--workers", "1")
    assert "1/1" not in again.stderr  # the journal has it
    assert json.loads((tmp_path / "a" / "open_loop.json").read_text())["overall"] == found


def test_an_agent_of_a_file_that_stands_and_then_fails(reference: Path, tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(AGENT)
    (tmp_path / "most.json").write_text('{"most": 5.0}')
    agent = ("--agent", f"{tmp_path / 'still.py'}:Still", "--agent-config", tmp_path / "most.json")
    done = run("eval-open", "--reference", reference, *agent, "--out", tmp_path / "b", "--workers", "1")
    assert done.exit_code == 0, done.output
    whole = json.loads((tmp_path / "b" / "open_loop.json").read_text())
    assert whole["overall"]["ap50"] is None
    assert whole["overall"]["ade"] > 1.0
    failures = whole["scenarios"][0]["failures"]
    assert failures and all("too fast" in why for why in failures.values())


def test_recorded_frames_are_those_of_the_episode(reference: Path) -> None:
    episode = load_episode(next((reference / "episodes").iterdir()))
    frame = rebuild_frame(episode, 30)
    assert list(frame.egos) == [name for name, there in zip(episode.ego_ids, episode.valid[30], strict=False) if there]
    ego = next(iter(frame.egos))
    column = episode.ids.index(ego)
    assert frame.egos[ego].acceleration == pytest.approx((episode.speed[30, column] - episode.speed[29, column]) * 20)


def test_bad_input(reference: Path, tmp_path: Path) -> None:
    nowhere = run("eval-open", "--reference", tmp_path / "nowhere", "--agent", "single")
    assert nowhere.exit_code == 2 and "nowhere" in nowhere.stderr
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in ("results.json", "journal.jsonl"):
        (bare / name).write_bytes((reference / name).read_bytes())
    missing = run("eval-open", "--reference", bare, "--agent", "single", "--out", tmp_path / "c")
    assert missing.exit_code == 2 and "eval without --no-record makes them" in missing.stderr
