"""`study comm`: table, numbers and pictures, interrupted and repeated studies, bad input."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import TALKER, LocalExecutor, run_in_process
from testing.paths import TESTS
from testing.study_samples import invoke

from mdrive_sumo.cli import main
from mdrive_sumo.scoring import load_results

FAKE_MAIN = [sys.executable, "-c", "from testing import study_fakes; study_fakes.main()"]


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Two scenarios, and an `evaluate` that drives them without processes and without SUMO."""
    made = fake_suite(monkeypatch, tmp_path, "answer", "answer")
    without_processes(monkeypatch)
    return made


def without_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    from testing import study_fakes

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", study_fakes.drive)


def fake_suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *deeds: str) -> Path:
    monkeypatch.syspath_prepend(str(TESTS))
    from testing import suite_fakes

    suite_fakes.make_suite(tmp_path / "suite", *deeds)
    return tmp_path / "suite"


def study(tmp_path: Path, *more: str | Path, agents: str = "stationary,idm") -> Result:
    out = () if "--out" in more else ("--out", tmp_path / "out")
    return invoke("study", "comm", "--suite", tmp_path / "suite", "--agents", agents, *out, "--workers", "1", *more)


def in_a_process(tmp_path: Path) -> "subprocess.Popen[str]":
    """The same as a process of its own, with workers."""
    given = ("--suite", str(tmp_path / "suite"), "--agents", "stationary", "--out", str(tmp_path / "out"))
    command = [*FAKE_MAIN, "study", "comm", *given, "--workers", "1", *BRIEF]
    path = os.pathsep.join((str(TESTS), os.environ.get("PYTHONPATH", "")))
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path})


def called(suite: Path) -> list[str]:
    return (suite / "calls").read_text().splitlines() if (suite / "calls").exists() else []


BRIEF = ("--latency", "6", "--no-captured")
SWEEP = ("--latency", "0,10", "--loss", "0.5", "--seeds", "2")


@pytest.mark.slow
def test_one_command_makes_the_table_the_numbers_and_the_pictures(suite: Path, tmp_path: Path) -> None:
    ended = study(tmp_path, *SWEEP)
    assert ended.exit_code == 0, ended.output
    out = tmp_path / "out"
    page = json.loads((out / "study.json").read_text())
    found = {(line["agent"], line["condition"]): line for line in page["lines"]}
    assert list(found)[:4] == [("stationary", name) for name in ("base", "off", "latency 10 ticks", "loss 0.5")]
    slow = found["stationary", "latency 10 ticks"]
    few = {"low": None, "high": None, "units": 1, "p_value": 1.0}  # both on one network
    assert slow["ds"]["mean"] == 60.5 and slow["ds_difference"] == {"mean": -10} | few
    assert slow["captured"]["scenario_mean"] == pytest.approx(0.5)
    assert slow["comm"]["latency_ticks"] == 10
    assert [one["seed"] for one in slow["runs"]] == [0, 1]
    assert found["stationary", "loss 0.5"]["sr_difference"]["mean"] == -10
    assert found["idm", "loss 0.5"]["reused"] and not found["idm", "base"]["reused"]
    table = (out / "study.md").read_text()
    assert "| latency 10 ticks | 60.5 [too few] | 30.2 [too few] |  |  | 0 | -10.0 [too few] |" in table
    assert "one factor at a time" in table and "![latency](latency.png)" in table
    pictures = {f"{name}.{kind}" for name in ("latency", "loss") for kind in ("png", "svg")}
    assert {path.name for path in out.iterdir()} == {"runs", "study.json", "study.md", *pictures}
    assert load_results(out / "runs" / "stationary" / "loss_0.5" / "seed1" / "results.json").run.comm["loss"] == 0.5


@pytest.mark.slow
def test_an_agent_without_messages_is_driven_once_and_finished_runs_never_again(suite: Path, tmp_path: Path) -> None:
    sweep = ("--latency", "0,10", "--seeds", "2")
    ended = study(tmp_path, *sweep)
    calls = called(suite)
    drivers = [call.split()[0] for call in calls]
    assert {name: drivers.count(name) for name in set(drivers)} == {"stationary": 12, "idm": 4, "omniscient": 4}
    assert len(set(calls)) == len(calls)
    assert "idm sends no messages: its base runs stand for all conditions" in ended.stderr
    assert "20/20" in ended.stderr.splitlines()[-1]
    before = (tmp_path / "out" / "study.json").read_bytes(), (tmp_path / "out" / "latency.svg").read_bytes()
    study(tmp_path, *sweep)
    assert called(suite) == calls
    assert before == ((tmp_path / "out" / "study.json").read_bytes(), (tmp_path / "out" / "latency.svg").read_bytes())
    study(tmp_path, "--latency", "0,10,20", "--seeds", "2")
    assert len(called(suite)) == len(calls) + 4


@pytest.mark.slow
def test_the_references_can_be_left_out_and_omniscient_is_driven_once(suite: Path, tmp_path: Path) -> None:
    ended = study(tmp_path, "--loss", "0.5", "--no-captured", "--no-record", agents="stationary")
    assert ended.exit_code == 0, ended.output
    assert "captured [%]" not in ended.stdout + (tmp_path / "out" / "study.md").read_text()
    assert len(called(suite)) == 4
    assert not list((tmp_path / "out").rglob("episodes"))
    study(tmp_path, "--loss", "0.5", "--out", str(tmp_path / "other"), agents="omniscient")
    assert len(called(suite)) == 6


@pytest.mark.slow
def test_the_whole_grid(suite: Path, tmp_path: Path) -> None:
    study(tmp_path, "--latency", "0,10", "--pose-error", "0,1", "--grid", "full", "--no-captured", agents="stationary")
    page = json.loads((tmp_path / "out" / "study.json").read_text())
    assert {line["condition"]: line["ds"]["mean"] for line in page["lines"]} == {
        "base": 70,
        "pose-error 1 m 1°": 60,
        "latency 10 ticks": 60,
        "latency 10 ticks, pose-error 1 m 1°": 50,
    }
    assert (tmp_path / "out" / "pose-error.png").is_file()


@pytest.mark.full  # in `make test`: finished runs are not driven again, above; Ctrl-C during eval (test_cli_eval)
def test_an_interrupted_study_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fake_suite(monkeypatch, tmp_path, "answer", "hang once")
    with in_a_process(tmp_path) as process:
        end = time.monotonic() + 30
        while not (folder / "s1.started").exists() or "s0" not in "".join(called(folder)):
            assert time.monotonic() < end
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == f"interrupted; the same command without --fresh continues {tmp_path / 'out'}"
    before = called(folder)
    without_processes(monkeypatch)
    ended = study(tmp_path, *BRIEF, agents="stationary")
    assert ended.exit_code == 0, ended.output
    assert sorted(called(folder)[len(before) :]) == sorted({*called(folder)} - {before[0]})
    assert "4/4" in ended.stderr.splitlines()[-1]


@pytest.mark.full
@pytest.mark.slow
def test_void_scenarios_are_exit_code_1_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_suite(monkeypatch, tmp_path, "answer", "kill")
    with in_a_process(tmp_path) as process:
        process.communicate(timeout=60)
    assert process.returncode == 1
    lines = json.loads((tmp_path / "out" / "study.json").read_text())["lines"]
    assert [(line["void"], line["ds"]["mean"]) for line in lines] == [(1, 70), (1, 64)]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--latency", "-1"), "study: --latency: expected whole numbers of ticks between 0 and 10000, found '-1'"),
        (("--latency", "1.5"), "study: --latency: expected whole numbers of ticks between 0 and 10000, found '1.5'"),
        (("--loss", "0,1.1"), "study: --loss: expected numbers between 0 and 1, found '1.1'"),
        (("--loss", "nan"), "study: --loss: expected numbers between 0 and 1, found 'nan'"),
        (("--loss", ""), "study: --loss: expected numbers with commas between them, found ''"),
        (("--loss", "0,,1"), "study: --loss: expected numbers with commas between them, found ''"),
        (("--loss", "0.1,0.1"), "study: --loss: expected different values, found one twice"),
        (("--pose-error", "inf"), "study: --pose-error: expected numbers of 0 or more, found 'inf'"),
        (("--pose-error", "1,2", "--rotation-error", "1"), "study: --rotation-error: expected 2 values, as"),
        (("--rotation-error", "1"), "study: --rotation-error: expected --pose-error with it, found none"),
        ((), "study: expected at least one of --latency, --loss, --pose-error, --connected-background and --channels"),
        (("--connected-background", "2"), "study: --connected-background: expected numbers between 0 and 1, found '2'"),
        (("--connected-background", "0.3"), "study: --connected-background: expected --comm its-g5 or lte-v2x, found"),
        (("--channels", "its-g5,5g"), "study: --channels: expected some of paper-latency, paper-pose, realistic,"),
        (("--channels", "ideal"), "study: --channels: expected some of paper-latency, paper-pose, realistic,"),
        (("--loss", "0", "--comm", "off"), "study: expected a base channel that is on, found --comm off"),
        (("--loss", "0", "--comm", "best"), "--comm: expected one of"),
        (("--loss", "0", "--agents", "idm,nobody"), "agent 'nobody': expected"),
        (("--loss", "0", "--agents", ""), "study: --agents: expected different agents with commas between them"),
        (("--loss", "0", "--agents", "idm,idm"), "study: --agents: expected different agents"),
        (("--loss", "0", "--agent-config", "idm"), "study: --agent-config: expected AGENT=FILE"),
        (("--loss", "0", "--agent-config", "x=y"), "study: --agent-config: expected AGENT=FILE"),
        (("--loss", "0", "--agent-clock", "slow"), "agent clock: expected"),
        (("--loss", "0", "--scenario", "zz"), "suite"),
        (("--loss", "0", "--seeds", "0"), "Invalid value for '--seeds'"),
    ],
)
def test_bad_input_is_one_sentence_before_anything_runs(
    suite: Path, tmp_path: Path, more: tuple[str, ...], sentence: str
) -> None:
    agents = () if "--agents" in more else ("--agents", "stationary")
    given = ["study", "comm", "--suite", str(suite), *agents, "--out", str(tmp_path / "out"), *more]
    ended = CliRunner().invoke(main, given)
    assert ended.exit_code == 2
    last = ended.stderr.splitlines()[-1]
    assert last.startswith(f"Error: {sentence}"), last
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_study_with_the_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_in_process(monkeypatch)
    given = (
        "--suite",
        "interdrive@0",
        "--scenario",
        "i02_*",
        "--agents",
        f"{TALKER},constant-speed",
        "--no-captured",
        "--workers",
        1,
    )
    ended = invoke("study", "comm", *given, "--loss", "1", "--out", tmp_path / "out")
    assert ended.exit_code == 0, ended.output
    page = json.loads((tmp_path / "out" / "study.json").read_text())
    base, lossy = (line for line in page["lines"] if line["agent"] == TALKER)
    heard, unheard = (line["runs"][0]["scenarios"]["i02_ins_c_boulevard_straight"] for line in (base, lossy))
    assert heard["digest"] != unheard["digest"]
    counts = unheard["comm"]
    assert counts["lost"] > 0 and counts["delivered"] == 0
    assert [line["reused"] for line in page["lines"] if line["agent"] == "constant-speed"] == [False, True]
