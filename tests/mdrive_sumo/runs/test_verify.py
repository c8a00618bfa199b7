"""`verify` and `rescore`: what a recording and a second execution have in common, and what not."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from testing.journals import rewrite_journal
from testing.local_executor import run_in_workers

from mdrive_sumo.cli import main
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode import load_episode, save_episode
from mdrive_sumo.runs.verify import sample_results
from mdrive_sumo.scoring import load_results

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]

SCENARIOS = "i0[12]_*"


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "run"
    ended = invoke(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        SCENARIOS,
        "--agent",
        "constant-speed",
        "--workers",
        1,
        "--out",
        folder,
    )
    assert ended.exit_code == 0, ended.output
    return folder


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    for file in finished.rglob("*"):
        if file.is_file():
            copy = tmp_path / file.relative_to(finished)
            copy.parent.mkdir(exist_ok=True)
            copy.write_bytes(file.read_bytes())
    return tmp_path


def recordings(folder: Path) -> list[Path]:
    return sorted((folder / "episodes").iterdir())


def test_a_run_verifies(finished: Path) -> None:
    ended = invoke("verify", finished, "--workers", 1)
    assert ended.exit_code == 0, ended.output
    ticks = {result.id: result.ticks for result in load_results(finished / "results.json").scenarios}
    lines = ended.stdout.splitlines()
    assert sorted(lines[:2]) == [f"{name}: identical ({ticks[name]} ticks)" for name in sorted(ticks)]
    files = ("results.json", "journal.jsonl", "report.md")
    assert lines[2:-1] == [f"{name}: every number as expected" for name in files]
    assert lines[-1] == "2 of 2 scenarios are identical"


def test_a_changed_recording_is_found_in_the_right_tick(copied: Path) -> None:
    path = recordings(copied)[0]
    recorded = load_episode(path)
    quanta, digests = recorded.quanta.copy(), recorded.digests.copy()
    quanta[37, 0, 0] += 5
    digests[37] ^= 1
    save_episode(replace(recorded, quanta=quanta, digests=digests), path)
    ended = invoke("verify", copied, "--workers", 1)
    assert ended.exit_code == 1
    assert f"{path.stem}: first difference at tick 37 (1.85 s): x of '{recorded.ids[0]}' is " in ended.stdout
    assert "1 of 2 scenarios are identical" in ended.stdout


def test_a_recording_of_another_run_is_found(copied: Path) -> None:
    first, second = recordings(copied)
    digests = load_episode(first).digests.copy()
    digests[-1] ^= 1
    save_episode(replace(load_episode(first), digests=digests), first)
    ended = invoke("verify", copied, "--workers", 1)
    assert ended.exit_code == 1
    assert f"{first.stem}: the recording's digest is " in ended.stdout
    assert f"{second.stem}: identical" in ended.stdout


def test_a_sample_is_always_the_same(finished: Path) -> None:
    results = load_results(finished / "results.json")
    assert [len(sample_results(results, size)) for size in (None, 1, 2, 9)] == [2, 1, 2, 2]
    turned = results.model_copy(update={"scenarios": results.scenarios[::-1]})
    assert sample_results(results, 1) == sample_results(turned, 1)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("verify", "expected a recording of mdrive-sumo, found a corrupt file"),
        ("rescore", "expected the recording that journal.jsonl notes, sha256:"),
    ],
)
def test_a_corrupt_recording_is_one_sentence(copied: Path, command: str, says: str) -> None:
    path = recordings(copied)[0]
    path.write_bytes(path.read_bytes()[:-300])
    ended = invoke(command, copied)
    assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1)
    assert f"Error: {path}: {says}" in ended.stderr


@pytest.mark.parametrize("command", ["verify", "rescore"])
def test_results_of_another_version_are_one_sentence(copied: Path, command: str) -> None:
    path = copied / "results.json"
    path.write_text(path.read_text().replace("mdrive-sumo/results/4", "mdrive-sumo/results/9"))
    ended = invoke(command, copied)
    assert (ended.exit_code, "expected 'mdrive-sumo/results/4'" in ended.stderr) == (2, True)


@pytest.mark.parametrize("command", ["verify", "rescore"])
def test_a_folder_that_is_no_run(tmp_path: Path, command: str) -> None:
    ended = invoke(command, tmp_path)
    assert (ended.exit_code, "expected a folder that `mdrive-sumo eval` has written" in ended.stderr) == (2, True)


def test_rescoring_gives_the_same_numbers(copied: Path) -> None:
    ended = invoke("rescore", copied)
    assert ended.exit_code == 0, ended.output
    assert load_results(copied / "results-mdrive.json") == load_results(copied / "results.json")


def test_rescoring_in_another_mode(copied: Path) -> None:
    ended = invoke("rescore", copied, "--score-mode", "interdrive_fixed")
    assert ended.exit_code == 0, ended.output
    again = load_results(copied / "results-interdrive_fixed.json")
    assert again.run.score_mode == "interdrive_fixed"
    for now, then in zip(again.scenarios, load_results(copied / "results.json").scenarios, strict=True):
        assert (now.digest, now.rc) == (then.digest, then.rc)
        assert now.ip == pytest.approx(float(np.prod([ego.ip for ego in then.egos])), abs=1e-6)


def test_without_recordings_final_digests_are_compared(tmp_path: Path) -> None:
    ended = invoke(
        "eval",
        "--suite",
        "interdrive@0",
        "--scenario",
        "i01_*",
        "--agent",
        "constant-speed",
        "--out",
        tmp_path,
        "--no-record",
    )
    assert ended.exit_code == 0, ended.output
    assert not (tmp_path / "episodes").exists()
    ended = invoke("verify", tmp_path)
    assert ended.exit_code == 0
    assert "only final digests are compared" in ended.stderr
    assert "(no recording)" in ended.stdout
    path = tmp_path / "results.json"
    digest = load_results(path).scenarios[0].digest
    path.write_text(path.read_text().replace(digest, "0" * 16))
    ended = invoke("verify", tmp_path)
    assert ended.exit_code == 1
    assert f"digest: expected '{digest}', found '{'0' * 16}'" in ended.stdout
    assert "made with --no-record" in invoke("rescore", tmp_path).stderr


AGENT = """
import time
from mdrive_sumo.contract import Control, Reply
class Sleeper:
    label = "single"
    def __init__(self, config): ...
    def sensors(self): return ()
    def start(self, briefing): ...
    def act(self, seen):
        if seen.tick == 12:
            time.sleep(60)
        return Reply(control=Control(throttle=0.5, brake=0.0, steer=0.0))
"""


@pytest.mark.full
def test_a_time_out_is_replayed(tmp_path: Path) -> None:
    """The agent needs 5 s of wall clock to time out when it is recorded, and none when it is verified."""
    (tmp_path / "sleeper.py").write_text(AGENT)
    agent = f"{tmp_path}/sleeper.py:Sleeper"
    ended = invoke(
        "eval", "--suite", "interdrive@0", "--scenario", "i01_*", "--agent", agent, "--out", tmp_path / "run"
    )
    assert ended.exit_code == 1, ended.output  # its agent failed
    first = load_results(tmp_path / "run" / "results.json").scenarios[0].egos[0]
    assert (first.outcome, first.reason.split(":")[0]) == (End.AGENT_FAILED, FailureReason.TIMEOUT)
    ended = invoke("verify", tmp_path / "run", "--trust-agent")
    assert (ended.exit_code, "identical" in ended.stdout) == (0, True), ended.output
    assert "taken from the recording: 2 agent failures" in ended.stdout


def test_a_run_of_another_version_is_warned_about(copied: Path) -> None:
    path = copied / "journal.jsonl"
    rewrite_journal(path, lambda line: line.replace('"libsumo":"1.28.0"', '"libsumo":"1.27.0"'))
    results = copied / "results.json"
    results.write_text(results.read_text().replace('"libsumo": "1.28.0"', '"libsumo": "1.27.0"'))
    report = copied / "report.md"
    report.write_text(report.read_text().replace("libsumo 1.28.0", "libsumo 1.27.0"))
    ended = invoke("verify", copied, "--sample", 1)
    assert ended.exit_code == 0
    assert ended.stderr == "warning: the run was made with another libsumo 1.27.0\n"


COMMAND = [sys.executable, "-c", "from mdrive_sumo.cli import main; main()"]


def digests(folder: Path) -> dict[str, str]:
    return {result.id: result.digest for result in load_results(folder / "results.json").scenarios}


def interrupted_run(words: list[str], journal: Path) -> None:
    """Starts a run, kills one of its workers, presses Ctrl-C when some scenarios are done."""
    with subprocess.Popen([*COMMAND, *words], stderr=subprocess.DEVNULL) as process:
        while not journal.exists() or journal.read_text().count("\n") < 3:
            time.sleep(0.1)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        os.kill(int(children[-1]), signal.SIGKILL)
        while "SIGKILL" not in journal.read_text():
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
    assert process.returncode == 130


@pytest.mark.full
@pytest.mark.parametrize(("pattern", "count"), [("i0*", 9), ("*", 46)], ids=["few", "all"])
def test_every_scenario_is_the_same_however_it_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pattern: str, count: int
) -> None:
    """One worker or two, interrupted, with a killed worker, in a fresh process or a used one: equal digests."""
    run_in_workers(monkeypatch)
    folders = {name: tmp_path / name for name in ("two", "interrupted")}
    command = ("eval", "--suite", "interdrive@0", "--agent", "constant-speed", "--scenario", pattern, "--out")
    words = {name: [*command, str(path)] for name, path in folders.items()}
    interrupted_run([*words["interrupted"], "--workers", "2"], folders["interrupted"] / "journal.jsonl")
    for name in folders:
        ended = invoke(*words[name], "--workers", 2)
        assert ended.exit_code == 0, ended.output
    expected = digests(folders["two"])
    assert len(expected) == count
    assert digests(folders["interrupted"]) == expected
    ended = invoke("verify", folders["interrupted"], "--workers", 1)
    assert (ended.exit_code, ended.stdout.splitlines()[-1]) == (0, f"{count} of {count} scenarios are identical")
