"""`mdrive-sumo eval-open` from the command to the file, on a run of a few seconds."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import run_in_process
from testing.recorded_drive_agent import RECORDED_DRIVE, register_recorded_drive
from testing.sandbox_runs import needs_bubblewrap, reachable
from testing.short_suite import make_short_suite

import mdrive_sumo as md
from mdrive_sumo.cli import main
from mdrive_sumo.episode import load_episode, rebuild_frame
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.open_loop import open_run_reference, prepare_open_loop
from mdrive_sumo.runs import worker_process
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.journal import read_journal
from mdrive_sumo.runs.stored_run import load_stored_run

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
    whole = json.loads((tmp_path / "a" / "open_loop.json").read_text())
    found = whole["overall"]
    assert found["frames"] > 20
    skipped = whole["scenarios"][0]["skipped"]["no 3 s to compare"]
    assert f"{skipped} frames with no 3 s to compare" in done.stdout
    assert found["ade"] < 2.0 and found["ade"] < found["fde"]
    assert 0.0 < found["ap50"] <= 100.0
    again = run("eval-open", "--reference", reference, "--agent", "single", "--out", tmp_path / "a", "--workers", "1")
    assert "1/1" not in again.stderr  # the journal has it
    assert json.loads((tmp_path / "a" / "open_loop.json").read_text())["overall"] == found


@pytest.mark.slow
def test_an_agent_of_a_file_that_stands_and_then_fails(reference: Path, tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(AGENT)
    (tmp_path / "most.json").write_text('{"most": 5.0}')
    agent = ("--agent", f"{tmp_path / 'still.py'}:Still", "--agent-config", tmp_path / "most.json")
    done = run("eval-open", "--reference", reference, *agent, "--out", tmp_path / "b", "--workers", "1")
    assert done.exit_code == 1, done.output
    assert "agent failed: i11_ins_sl_town seed 0, CAV " in done.stdout and "ValueError: too fast" in done.stdout
    whole = json.loads((tmp_path / "b" / "open_loop.json").read_text())
    assert whole["overall"]["ap50"] is None
    assert whole["overall"]["ade"] > 1.0
    failures = whole["scenarios"][0]["failures"]
    assert failures and all("too fast" in why for why in failures.values())
    listed = run("list", "runs", tmp_path / "b").stdout.splitlines()[-1]
    assert "still.py:Still (most 5.0)" in listed and listed.endswith("finished, open loop")


def test_recorded_frames_are_those_of_the_episode(reference: Path) -> None:
    episode = load_episode(next((reference / "episodes").iterdir()))
    frame = rebuild_frame(episode, 30)
    assert list(frame.egos) == [name for name, there in zip(episode.ego_ids, episode.valid[30], strict=False) if there]
    ego = next(iter(frame.egos))
    column = episode.ids.index(ego)
    assert frame.egos[ego].acceleration == pytest.approx((episode.speed[30, column] - episode.speed[29, column]) * 20)


def test_the_plan_that_was_driven_has_no_error_and_what_was_there_is_all_detected(
    reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    register_recorded_drive(monkeypatch)
    recording = reference / "episodes" / "i11_ins_sl_town.npz"
    (tmp_path / "own.json").write_text(json.dumps({"recording": str(recording)}))
    agent = ("--agent", RECORDED_DRIVE, "--agent-config", tmp_path / "own.json", "--ids", "scenario")
    done = run("eval-open", "--reference", reference, *agent, "--out", tmp_path / "own", "--workers", "1")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "own" / "open_loop.json").read_text())["overall"]
    assert found["frames"] > 20
    assert (found["ade"], found["fde"], found["ap50"], found["overlap"]) == (0.0, 0.0, 100.0, 0.0)


def test_the_python_front_door_does_the_same(reference: Path, tmp_path: Path) -> None:
    options = {"out": tmp_path / "python", "workers": 1, "progress": False}
    found = md.evaluate_open("constant-speed", md.load_run(reference), scenario="i11*", seed=0, **options)
    place = ("--reference", reference, "--agent", "constant-speed", "--workers", "1", "--out", tmp_path / "command")
    assert run("eval-open", *place).exit_code == 0
    written = json.loads((tmp_path / "command" / "open_loop.json").read_text())
    assert found.model_dump(mode="json") == written
    with pytest.raises(md.InputError, match="did you mean 'log'"):
        md.evaluate_open("idm", "logs", **options)


def test_a_worker_that_dies_twice_over_a_recording_stops_the_command_and_is_noted(
    reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries: list[object] = []

    def die(_: object, job: object) -> worker_process.WorkerFailure:
        tries.append(job)
        return worker_process.WorkerFailure(worker_process.FailureKind.DIED, "worker died (signal 9)")

    monkeypatch.setattr(worker_process, "run_job_guarded", die)
    done = run("eval-open", "--reference", reference, "--agent", "idm", "--out", tmp_path, "--workers", "1")
    assert (done.exit_code, len(tries)) == (1, 2)
    assert "i11_ins_sl_town: worker died (signal 9); the same command tries again" in done.stderr
    lines = read_journal(tmp_path / "journal.jsonl").lines
    assert [line["failed"]["scenario"] for line in lines[1:]] == ["i11_ins_sl_town"] * 2


@pytest.mark.slow
@needs_bubblewrap
def test_a_box_hides_suite_and_recordings(reference: Path, tmp_path: Path) -> None:
    """What the box shows is tested with `eval --sandbox`; the agent stands in it as without one."""
    folder = reachable(tmp_path) / "mine"
    folder.mkdir()
    (folder / "still.py").write_text(AGENT)
    agent = f"{folder / 'still.py'}:Still"
    opened = open_run_reference(load_stored_run(reference))
    made = prepare_open_loop(opened, AgentSpec(agent), EpisodeOptions(), tmp_path / "out", sandbox=True)
    assert made.agent.box is not None
    assert {opened.suite.folder.resolve(), reference.resolve()} <= {*made.agent.box.hidden}
    assert made.info.labels == () and made.info.agent == "../mine/still.py:Still"
    command = ("eval-open", "--reference", reference, "--agent", agent, "--workers", "1")
    boxed = run(*command, "--sandbox", "--out", tmp_path / "boxed")
    assert boxed.exit_code == 0, boxed.output
    found = json.loads((tmp_path / "boxed" / "open_loop.json").read_text())
    assert found["overall"]["frames"] > 20 and found["run"]["labels"] == []
    assert found["run"]["sensing_track"] == "object"


def test_an_agent_without_a_box_is_labelled(reference: Path, tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(AGENT)
    opened = open_run_reference(load_stored_run(reference))
    made = prepare_open_loop(opened, AgentSpec(f"{tmp_path / 'still.py'}:Still"), EpisodeOptions(), tmp_path / "out")
    assert made.info.labels == ("unsandboxed",)
    assert made.limit_s() > 600.0  # its own time, not that of the reference's agent


def copy_run(reference: Path, folder: Path) -> Path:
    """Copy a run beside its suite, to which its journal has a relative path."""
    copy = reference.with_name(f"{folder.parent.name}-{folder.name}")
    shutil.copytree(reference, copy)
    return copy


def test_recordings_that_are_missing_or_changed_are_refused(reference: Path, tmp_path: Path) -> None:
    bare = copy_run(reference, tmp_path / "bare")
    recording = bare / "episodes" / "i11_ins_sl_town.npz"
    recording.write_bytes(recording.read_bytes() + b"0")
    changed = run("eval-open", "--reference", bare, "--agent", "single", "--out", tmp_path / "c")
    assert changed.exit_code == 2 and "expected the recording that journal.jsonl notes" in changed.stderr
    shutil.rmtree(bare / "episodes")
    missing = run("eval-open", "--reference", bare, "--agent", "single", "--out", tmp_path / "c")
    assert missing.exit_code == 2 and "eval without --no-record makes them" in missing.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--reference", "nowhere"),
            "omniscient, log or the folder of a finished run, found 'nowhere'",
        ),
        (("--reference", "omnicient"), "found 'omnicient'; did you mean 'omniscient'?"),
        (("--reference", "RUN", "--suite", "v2xpnp@0"), "expected a run of the suite v2xpnp@0, found one of short"),
        (("--reference", "RUN", "--scenario", "i12"), "expected a scenario id or category like 'i12', found none"),
        (("--reference", "RUN", "--seed", "3"), "found none; it has '*' with seed 0"),
        (("--reference", "RUN", "--agent", "singel"), "found neither; did you mean 'single'?"),
        (("--reference", "log", "--suite", "v2xpnp@0", "--seed", "1"), "expected 0 with --reference log, found 1"),
        (("--reference", "log", "--suite", "interdrive@0", "--scenario", "i11*"), "i11_ins_sl_town, found no file"),
    ],
)
def test_bad_input(arguments: tuple[str, ...], sentence: str, reference: Path, tmp_path: Path) -> None:
    filled = [str(reference) if one == "RUN" else one for one in arguments]
    done = run("eval-open", *filled, "--out", tmp_path / "never")
    assert done.exit_code == 2, done.output
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert sentence in line
    assert not (tmp_path / "never").exists()
