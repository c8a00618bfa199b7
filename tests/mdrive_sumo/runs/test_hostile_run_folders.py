"""A stranger's run folder: links, devices, escape sequences, numbers without end, and code that it names."""

import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from testing.fuzz_runs import RunHarness
from testing.hostile_runs import BIDI, ESCAPE, FORMULA, IMAGE, KEY, change_arrays, change_header, read_lines, sign

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def harness(tmp_path_factory: pytest.TempPathFactory) -> RunHarness:
    return RunHarness(tmp_path_factory.mktemp("runs"))


@pytest.fixture
def run(harness: RunHarness) -> Path:
    """A copy of a valid run; the harness finds what is written into `outside`, and escape sequences in outputs."""
    return harness.copy_run()


def edit_results(run: Path, change: Callable[[Any], None]) -> None:
    data = json.loads((run / "results.json").read_text())
    change(data)
    (run / "results.json").write_text(json.dumps(data))


COMMANDS: Mapping[str, tuple[str, ...]] = {
    "view": ("--no-open", "--replays", "all"),
    "rescore": (),
    "show": (),
    "verify": (),
    "render": ("--out", "OUT/x.png"),
    "export": ("--format", "csv", "--out", "OUT/csv"),
    "compare": ("OTHER",),
    "report": ("OTHER", "--out", "OUT/report"),
    "eval": ("--suite", "SUITE", "--agent", "stationary", "--out", "RUN"),
}


def call(harness: RunHarness, name: str, run: Path) -> tuple[int, str]:
    """Call a command on a run; return its exit code and the last line of its errors, or of its output."""
    places = {"OUT": run.parent / "out", "OTHER": harness.other, "SUITE": run.parent / "suite", "RUN": run}
    words = [*COMMANDS[name]]
    for key, place in places.items():
        words = [word.replace(key, str(place)) for word in words]
    ended = harness.call([name, *([] if name == "eval" else [str(run)]), *words])
    return ended.exit_code, (ended.stderr or ended.output).strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("place", "command"),
    [
        ("view/index.html", "view"), ("view", "view"), ("results-mdrive.tmp", "rescore"),
        ("results-mdrive.json", "rescore"), ("report.md", "eval"),
        ("journal.jsonl", "eval"), ("episodes/s0.npz", "eval"), ("results.json", "eval"),
        ("results.tmp", "eval"), ("view/s0.html", "view"), ("logs", "eval"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("target", ["keys", "."])
def test_nothing_is_written_through_a_link(
    harness: RunHarness, run: Path, place: str, command: str, target: str
) -> None:
    """`RunHarness.call` raises if a file outside of the run has changed or is new."""
    path = run / place
    path.parent.mkdir(exist_ok=True)
    if path.is_file():
        path.unlink()
    path.symlink_to(harness.outside / target)
    code, error = call(harness, command, run)
    assert (code, error) == (2, f"Error: {path}: expected a run of regular files and folders, found a link; remove it")


UNREAD = {("compare", "journal.jsonl"), ("compare", "episodes/s0.npz")}
"""What a command does not need."""


@pytest.mark.parametrize("command", ["view", "compare", "report"])
@pytest.mark.parametrize("place", ["view", "results.json", "episodes/s9.npz"])
def test_a_run_that_is_not_finished_has_no_links_either(
    harness: RunHarness, run: Path, command: str, place: str
) -> None:
    """A journal is enough for these commands, and a link to a folder in the place of results is no results."""
    (run / "results.json").unlink()
    (run / place).symlink_to(harness.outside, target_is_directory=True)
    code, error = call(harness, command, run)
    expected = f"Error: {run / place}: expected a run of regular files and folders, found a link; remove it"
    assert (code, error) == (2, expected)


@pytest.mark.parametrize("command", ["view", "compare", "eval"])
@pytest.mark.parametrize("place", ["journal.jsonl", "episodes/s0.npz", "results.json"])
@pytest.mark.parametrize("kind", ["device", "pipe", "endless"])
def test_what_is_no_file_is_not_read(harness: RunHarness, run: Path, command: str, place: str, kind: str) -> None:
    path = run / place
    path.unlink()
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        with path.open("wb") as file:
            file.truncate(2**40)
    code, error = call(harness, command, run)
    is_replaced = command == "eval" and place != "journal.jsonl"  # by a file that is driven anew
    if kind != "endless" or not (is_replaced or (command, place) in UNREAD):
        assert code == 2 and error.startswith("Error: "), error


@pytest.mark.parametrize("factor", [1e308, -1e308, 1.5])
@pytest.mark.parametrize("command", ["view", "rescore", "show", "render", "export", "compare", "report"])
def test_a_factor_that_cannot_be_is_one_sentence(harness: RunHarness, run: Path, command: str, factor: float) -> None:
    event = {"kind": "collision-vehicle", "tick": 1, "x": 0, "y": 0, "factor": factor, "other": "x"}
    edit_results(run, lambda data: data["scenarios"][0]["egos"][0].update(infractions=[event] * 2))
    code, error = call(harness, command, run)
    assert code == 2 and ".egos[0].infractions[0].factor: expected 0 to 1, found" in error


@pytest.mark.parametrize("name", ["x", "y", "tick", "impact_speed"])
@pytest.mark.parametrize("value", [1e308, 10**400])
def test_so_is_a_place_or_a_time_without_end(harness: RunHarness, run: Path, name: str, value: float) -> None:
    event = {"kind": "collision-vehicle", "tick": 1, "x": 0, "y": 0, "factor": 1, "other": "x", name: value}
    edit_results(run, lambda data: data["scenarios"][0]["egos"][0].update(infractions=[event]))
    code, _ = call(harness, "view", run)
    assert code == 2


def test_a_setting_that_is_no_line_of_text_is_one_sentence(harness: RunHarness, run: Path) -> None:
    """Figures of a report name the settings in which runs differ."""
    edit_results(run, lambda data: data["run"].update(friction="\ud800"))
    code, error = call(harness, "report", run)
    assert code == 2 and "run.friction: expected a line of text, found '\\ud800'" in error, error


@pytest.mark.parametrize("command", ["compare", "report", "rescore", "show", "view"])
@pytest.mark.parametrize("text", [ESCAPE, BIDI, KEY, "x" * 5000, "\ud800"])
def test_a_name_is_a_line_of_text(harness: RunHarness, run: Path, command: str, text: str) -> None:
    edit_results(run, lambda data: data["run"].update(agent=text))
    code, error = call(harness, command, run)
    assert code == 2 and "results.json: run.agent: expected " in error


@pytest.mark.parametrize("field", ["category", "reason"])
def test_a_continued_run_has_text_that_files_can_hold(harness: RunHarness, run: Path, field: str) -> None:
    lines = read_lines(run)
    lines[1]["result"][field] = "\ud800"
    sign(run, lines)
    (run / "results.json").unlink()
    code, error = call(harness, "eval", run)
    assert code == 2 and "journal.jsonl: expected text, found a lone surrogate" in error


def test_so_has_a_rescored_one(harness: RunHarness, run: Path) -> None:
    edit_results(run, lambda data: data["run"].update(versions={"python": "\ud800"}))
    code, error = call(harness, "rescore", run)
    assert code == 2 and "expected text, found a lone surrogate" in error


@pytest.mark.parametrize("text", [FORMULA, IMAGE])
def test_a_name_is_neither_a_formula_nor_an_image(harness: RunHarness, run: Path, text: str) -> None:
    """`RunHarness.call` looks at every table and page that is written."""
    edit_results(run, lambda data: data["run"].update(agent=text))
    assert call(harness, "report", run)[0] == 0
    page = (run.parent / "out" / "report" / "report.md").read_text()
    tables = [path.read_text() for path in (run.parent / "out" / "report" / "csv").iterdir()]
    assert text not in page or text == FORMULA
    assert any("HYPERLINK" in table for table in tables) == (text == FORMULA)
    assert not any(line.lstrip('"').startswith("=") for table in tables for line in table.splitlines())


@pytest.mark.parametrize("command", ["view", "rescore", "render", "export"])
def test_a_recording_of_foreign_cavs_is_one_sentence(harness: RunHarness, run: Path, command: str) -> None:
    change_header(run, "s0", lambda text: text.replace('"0"', '"foreign"'))
    code, error = call(harness, command, run)
    assert code == 2 and "expected scenario s0 with CAVs 0, found s0 with foreign" in error


def test_a_recording_that_contradicts_itself_is_one_sentence(harness: RunHarness, run: Path) -> None:
    change_arrays(run, "s0", lambda arrays: arrays["quanta"].fill(2**15 - 1))
    code, error = call(harness, "rescore", run)
    assert code == 2 and error.startswith(f"Error: {run}/episodes/s0.npz: episode of s0: CAV 0 is recorded as arrived")


def test_an_id_in_a_recording_has_a_length(harness: RunHarness, run: Path) -> None:
    change_header(run, "s0", lambda text: text.replace('"0"', f'"{"x" * 5000}"'))
    code, error = call(harness, "view", run)
    assert code == 2 and "an id that is no line of text of at most 1000 characters" in error


MARK = "from pathlib import Path\n(Path(__file__).parent / 'was-run').touch()\n"


@pytest.fixture
def package(run: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of the stranger on the path, as in the folder of a `python -m`, which the run names as its agent."""
    folder = run.parent / "strange"
    folder.mkdir()
    (folder / "__init__.py").write_text(MARK)
    (folder / "agent.py").write_text(MARK)
    monkeypatch.syspath_prepend(str(run.parent))
    lines = read_lines(run)
    lines[0]["fingerprint"]["agent"] = "strange.agent:Driver"
    sign(run, lines)
    return folder


@pytest.mark.parametrize("option", ["--sandbox", "--trust-agent", ""])
def test_no_package_is_imported_for_a_checksum(harness: RunHarness, run: Path, package: Path, option: str) -> None:
    ended = harness.call(["verify", str(run), *([option] if option else [])])
    assert ended.exit_code == 2
    expected = {
        "--sandbox": "--sandbox: expected path.py:Class or carla:path.py, whose folder a box can show, found",
        "--trust-agent": "the agent has changed since this run: expected strange.agent:Driver",
        "": "the agent has changed since this run: expected strange.agent:Driver",
    }
    assert expected[option] in ended.stderr
    assert not (package / "was-run").exists()


@pytest.mark.parametrize("agent", ["os:system", "builtins:eval", "sys:exit", "no.such.module:Driver", "strange:x"])
@pytest.mark.parametrize("option", ["--sandbox", "--trust-agent"])
def test_a_module_of_python_is_one_sentence(harness: RunHarness, run: Path, agent: str, option: str) -> None:
    lines = read_lines(run)
    lines[0]["fingerprint"] |= {"agent": agent, "agent_code": "sha256:00"}
    sign(run, lines)
    ended = harness.call(["verify", str(run), option])
    assert ended.exit_code == 2, ended.output


def test_the_run_itself_is_read_and_written(harness: RunHarness, run: Path) -> None:
    """So that no test above passes because a command cannot work at all."""
    shutil.rmtree(run.parent / "out")
    (run.parent / "out").mkdir()
    assert {name: call(harness, name, run)[0] for name in COMMANDS} == dict.fromkeys(COMMANDS, 0)
