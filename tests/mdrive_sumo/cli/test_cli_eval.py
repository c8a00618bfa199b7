"""The command line itself, as a user starts it; `suite_fakes` stands in for the simulation."""

import json
import os
import pty
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import LocalExecutor
from testing.paths import TESTS

from mdrive_sumo.cli import main

pytestmark = pytest.mark.slow

FAKE_MAIN = [sys.executable, "-c", "from testing import suite_fakes; suite_fakes.main()"]


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TESTS))
    from testing import suite_fakes

    return suite_fakes


@pytest.fixture
def here(fakes: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """`evaluate` in this process and without worker processes."""

    def evaluate_here(*more: str, default_folder: bool = False) -> Result:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
        monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", fakes.drive)
        given = arguments(tmp_path, *more)[len(FAKE_MAIN) :]
        left_out = ("--out", str(tmp_path / "run")) if default_folder else ()
        return CliRunner().invoke(main, [word for word in given if word not in left_out])

    return evaluate_here


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join((str(TESTS), os.environ.get("PYTHONPATH", "")))}


def arguments(tmp_path: Path, *more: str) -> list[str]:
    out = () if "--out" in more else ("--out", str(tmp_path / "run"))
    agent = () if "--agent" in more else ("--agent", "stationary")
    return [*FAKE_MAIN, "eval", "--suite", str(tmp_path / "suite"), *agent, *out, *more]


def evaluate(tmp_path: Path, *more: str, limit: Callable[[], None] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        arguments(tmp_path, *more),
        capture_output=True,
        text=True,
        env=environment(),
        preexec_fn=limit,
        cwd=tmp_path,
    )


def start(tmp_path: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        arguments(tmp_path, *more),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )


def wait_for(path: Path) -> None:
    end = time.monotonic() + 60.0
    while not (path.exists() and path.read_text()):
        assert time.monotonic() < end, f"{path} never came"
        time.sleep(0.02)


def journalled(tmp_path: Path) -> list[str]:
    lines = (tmp_path / "run" / "journal.jsonl").read_text().splitlines()[1:]
    return [json.loads(line)["result"]["id"] for line in lines]


def test_a_run_ends_with_a_table_and_the_files_that_exist(
    fakes: ModuleType, here: Callable[..., Result], tmp_path: Path
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    ended = here()
    assert (ended.exit_code, ended.stderr.count("\n")) == (0, 3)  # what it costs, and a line for each
    assert "Tiny" in ended.stdout and "scenario mean" in ended.stdout
    files = [Path(line.split("  ")[0]) for line in ended.stdout.splitlines() if line.startswith(str(tmp_path))]
    assert [file.name for file in files] == ["results.json", "report.md", "journal.jsonl", "episodes"]
    assert all(file.exists() for file in files)
    assert ended.stderr.splitlines()[2].startswith("2/2  DS   5.0  SR   0.0  eta 0:00  s")


def test_the_default_folder_is_found_again(fakes: ModuleType, here: Callable[..., Result], tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer")
    for expected in (True, False):
        ended = here(default_folder=True)
        assert ("1/1" in ended.stderr) is expected
    assert "already complete; --fresh runs it again" in ended.stderr
    assert (tmp_path / "runs" / "tiny-stationary-seed0" / "results.json").is_file()


def test_a_void_makes_exit_code_1_and_is_named(fakes: ModuleType, here: Callable[..., Result], tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "world")
    ended = here()
    assert ended.exit_code == 1
    assert "s1: SUMO lost the road; tried again later" in ended.stderr
    assert "  s1: SUMO lost the road" in ended.stdout


def test_ctrl_c_keeps_what_is_done_and_the_same_command_continues(
    fakes: ModuleType, here: Callable[..., Result], tmp_path: Path
) -> None:
    suite = fakes.make_suite(tmp_path / "suite", "hang once", "answer", "answer")
    with start(tmp_path, "--workers", "2") as process:
        wait_for(tmp_path / "run" / "s0.started")
        while "s2" not in (tmp_path / "run" / "journal.jsonl").read_text():
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == f"interrupted; the same command continues {tmp_path / 'run'}"
    assert "Traceback" not in errors
    assert journalled(tmp_path) == ["s1", "s2"]
    ended = here("--workers", "2")
    assert ended.exit_code == 0
    assert "continuing: 2 of 3 scenarios are done already" in ended.stderr
    assert journalled(tmp_path) == ["s1", "s2", "s0"]
    assert suite.name in ended.stdout


def test_a_second_ctrl_c_does_not_swallow_the_answer_to_the_first(
    fakes: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer")

    def interrupt(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("mdrive_sumo.cli.evaluate.evaluate_run", interrupt)
    monkeypatch.setattr("mdrive_sumo.cli.evaluate.ProgressDisplay.close", interrupt)
    before = signal.getsignal(signal.SIGINT)
    try:
        answer = CliRunner().invoke(main, arguments(tmp_path)[len(FAKE_MAIN) :])
    finally:
        signal.signal(signal.SIGINT, before)
    assert answer.exit_code == 130
    assert answer.stderr == f"interrupted; the same command continues {tmp_path / 'run'}\n"


def test_a_killed_parent_takes_its_workers_along_and_the_run_continues(
    fakes: ModuleType, here: Callable[..., Result], tmp_path: Path
) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "hang once")
    with start(tmp_path, "--workers", "1") as process:
        wait_for(tmp_path / "run" / "s1.started")
        process.kill()
    worker = int((tmp_path / "run" / "s1.started").read_text())
    ended = here("--workers", "1")
    assert ended.exit_code == 0
    assert journalled(tmp_path) == ["s0", "s1"]
    assert not Path(f"/proc/{worker}/fd/0").exists()


@pytest.mark.full
def test_two_at_once_on_one_run(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "hang once")
    with start(tmp_path) as process:
        wait_for(tmp_path / "run" / "s0.started")
        ended = evaluate(tmp_path)
        process.kill()
    assert ended.returncode == 2
    assert (
        ended.stderr == f"Error: {tmp_path / 'run'}: expected a free run folder, found another process at work in it\n"
    )


@pytest.mark.full
def test_a_disk_that_is_full(fakes: ModuleType, tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk; the run continues when there is room again."""
    fakes.make_suite(tmp_path / "suite", *["answer"] * 8)
    evaluate(tmp_path)
    room = (tmp_path / "run" / "journal.jsonl").stat().st_size - 100
    ended = evaluate(tmp_path, "--fresh", limit=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)))
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith(f"Error: {tmp_path / 'run' / 'journal.jsonl'}: cannot be written")
    assert "Traceback" not in ended.stderr
    done = evaluate(tmp_path)
    assert done.returncode == 0
    assert "the last line of the journal was incomplete and has been dropped" in done.stderr
    assert "scenarios are done already" in done.stderr


@pytest.mark.full
def test_a_full_disk_under_a_recording(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "full")
    ended = evaluate(tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.endswith("Error: the run folder: cannot be written: No space left on device\n")


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--agent", "nobody"), "Error: agent 'nobody': expected"),
        (
            ("--workers", "0"),
            "Error: Invalid value for '--workers': expected a positive number or auto, found '0'",
        ),
        (("--seed", "-1"), "Error: Invalid value for '--seed'"),
        (("--score-mode", "kind"), "Error: Invalid value for '--score-mode'"),
        (("--agent-config", "none.json"), "Error: none.json: cannot be read: No such file or directory"),
        (("--out", "/proc/run"), "Error: /proc/run: cannot be written"),
        (("--what",), "Error: No such option"),
    ],
)
def test_usage_and_input_errors_exit_2(fakes: ModuleType, tmp_path: Path, more: tuple[str, ...], sentence: str) -> None:
    fakes.make_suite(tmp_path / "suite", "answer")
    ended = CliRunner().invoke(main, [*arguments(tmp_path, *more)[len(FAKE_MAIN) :]])
    assert ended.exit_code == 2
    assert ended.stderr.splitlines()[-1].startswith(sentence)
    assert isinstance(ended.exception, SystemExit)


def test_a_reader_that_leaves_early_is_no_error() -> None:
    reader = f"{sys.executable} -c 'from mdrive_sumo.cli import main; main()' --help | true"
    ended = subprocess.run(reader, shell=True, capture_output=True, text=True)
    assert ended.stderr == ""


def test_a_terminal_gets_one_live_line(fakes: ModuleType, tmp_path: Path) -> None:
    fakes.make_suite(tmp_path / "suite", "answer", "answer")
    ours, theirs = pty.openpty()
    command = arguments(tmp_path, "--workers", "1")
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, env=environment()) as process:
        os.close(theirs)
        seen = b""
        while chunk := _read(ours):
            seen += chunk
    os.close(ours)
    assert process.returncode == 0
    assert "2/2" in seen.decode()
    cost, _, seen = seen.partition(b"\n")
    assert cost.startswith(b"2 episodes (2 scenarios), 2 drives of CAVs, at most ")
    assert b"\n" not in seen
    assert seen.endswith(b"\r\x1b[K")


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # Linux says EIO when the other side is gone
        return b""
