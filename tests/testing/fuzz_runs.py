"""Run folders that somebody sent, hostile ones, fed to every command that reads one.

`python -m testing.fuzz_runs SECONDS SEED FOLDER` tries for some seconds; it ends with the exit code 0, or with another
one and the run in FOLDER/finding. No tests in here.
"""

import json
import os
import random
import re
import resource
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.api.run import load_run
from mdrive_sumo.cli import main as command_line
from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import MdriveError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame, save_episode
from mdrive_sumo.runs import journal as journals
from mdrive_sumo.runs.episode_job import EpisodeJob, score_job_episode
from mdrive_sumo.scoring import ScenarioResult
from testing import suite_fakes
from testing.fuzz_process import MEMORY_BYTES
from testing.local_executor import LocalExecutor

ESCAPE = "\x1b]0;owned\x07\x1b[2J"
BIDI = "\u202egnp.\u2066exe"
FORMULA = '=HYPERLINK("http://evil.example/";"x")'
IMAGE = "![x](http://evil.example/x.png)"
MARKUP = '</script><script>alert(1)</script><img src=x onerror="alert(1)">'
KEY = "\nssh-ed25519 AAAAevil attacker\n"
WORDS = (
    "", "x" * 5000, ESCAPE, BIDI, FORMULA, IMAGE, MARKUP, KEY, "a\nb", "\0", "\ud800", "../../outside/owned",
    "/dev/zero", "os:system", "@SUM(1)", "nan", "é" * 300, "\u2028", "s0", "-", "`|`", "\\](http://evil.example)",
)  # fmt: skip
NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2**31, 2**63, -(2**63), 10**400, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -0.0, 10**18, 0.5,
)  # fmt: skip
OTHERS: tuple[Any, ...] = (None, True, [], {}, [[]], {"": 0}, ["x"])
SEEN = ("\x1b", "\x07", "\u202e", "\u2066", "\u2028", "\x00")
"""What must never reach a terminal."""


def record_episode(scenario: str) -> EpisodeRecord:
    """A CAV that drives four metres and arrives."""
    recorder = Recorder(scenario, {"agent": "stationary", "seed": 0}, {"0": (4.9, 2.0)})
    for tick in range(3):
        frame = Frame(tick, {"0": EgoState(2.0 * tick, 0.0, 0.0, 2.0)}, Actors.empty(), {})
        recorder.add(quantize_frame(frame), {"0": Control(0.5, 0.0, 0.0)}, {}, {})
    return recorder.finish([Ending("0", 2, End.ARRIVED)])


def drive(job: EpisodeJob) -> ScenarioResult:
    """Stands in for `run_job`, with a real recording and real scores."""
    episode = record_episode(job.scenario)
    assert job.recording is not None
    save_episode(episode, job.recording)
    return score_job_episode(job, episode)


def make_valid_run(folder: Path) -> Path:
    """A run of two scenarios in FOLDER/run, with its suite beside it."""
    suite_fakes.make_suite(folder / "suite", "answer", "answer")
    run = folder / "run"
    arguments = ["eval", "--suite", str(folder / "suite"), "--agent", "stationary", "--out", str(run)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
        patch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
        ended = CliRunner().invoke(command_line, arguments)
    assert ended.exit_code == 0, ended.output
    return run


# ---------------------------------------------------------------- what a stranger does to a run


def _list_leaves(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (container, key) of everything in a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in [*items]:
        yield value, key
        yield from _list_leaves(inner)


def _change_value(data: Any, draws: random.Random) -> None:
    """Change one value of a JSON value, mostly into one of its own type."""
    container, key = draws.choice([*_list_leaves(data)])
    old = container[key]
    if draws.random() < 0.15:
        container[key] = draws.choice(OTHERS)
    elif isinstance(container, dict) and draws.random() < 0.1:
        container[draws.choice(WORDS)] = container.pop(key)
    elif isinstance(old, str):
        container[key] = draws.choice(WORDS)
    elif isinstance(old, int | float):
        container[key] = draws.choice(NUMBERS)
    elif isinstance(old, list) and old and draws.random() < 0.5:
        old.append(old[0])
    else:
        container[key] = draws.choice((draws.choice(WORDS), draws.choice(NUMBERS)))


def change_results(run: Path, draws: random.Random) -> None:
    """Change a value of results.json."""
    path = run / "results.json"
    data = json.loads(path.read_text())
    _change_value(data, draws)
    path.write_text(json.dumps(data))


def _read_lines(run: Path) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
    for line in lines:
        line.pop("checksum", None)
    return lines


def _sign(run: Path, lines: list[dict[str, Any]]) -> None:
    """Write a journal with checksums that fit."""
    checksum, text = "", ""
    for line in lines:
        body = json.dumps(line, separators=(",", ":"))
        checksum = journals._compute_checksum(checksum, body.encode())
        text += f'{body[:-1]},"checksum":"{checksum}"}}\n'
    (run / "journal.jsonl").write_text(text)


def change_journal(run: Path, draws: random.Random) -> None:
    """Change a value of the journal, and sign it."""
    lines = _read_lines(run)
    _change_value(draws.choice(lines[:1] if draws.random() < 0.5 else lines), draws)
    _sign(run, lines)


def change_everywhere(run: Path, draws: random.Random) -> None:
    """Change one word in results and journal alike."""
    data, lines = json.loads((run / "results.json").read_text()), _read_lines(run)
    words = sorted({c[k] for c, k in _list_leaves(data) if isinstance(c[k], str)})
    old, new = draws.choice((*words, *("stationary", "tiny", "deed", "Tiny") * 3)), draws.choice(WORDS)
    for container, key in (*_list_leaves(data), *_list_leaves(lines)):
        if isinstance(container[key], str) and container[key] == old:
            container[key] = new
    (run / "results.json").write_text(json.dumps(data))
    _sign(run, lines)


def change_recording(run: Path, draws: random.Random) -> None:
    """Change header or arrays of a recording, and sign it in the journal."""
    path = draws.choice(sorted((run / "episodes").glob("*.npz")))
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if draws.random() < 0.6:
        header = json.loads(arrays["header"].tobytes())
        _change_value(header, draws)
        text = json.dumps(header).encode("utf-8", "surrogatepass")
        arrays["header"] = np.frombuffer(text, np.uint8)
    else:
        name = draws.choice(sorted(set(arrays) - {"header"}))
        info = np.iinfo(arrays[name].dtype) if arrays[name].dtype.kind in "iu" else None
        changed = arrays[name].copy()
        if changed.size:
            extremes = (info.min, info.max, 0) if info else (np.nan, np.inf, -np.inf, 3.4e38, 0.0, -1.0)
            changed.flat[draws.randrange(changed.size)] = draws.choice(extremes)
        if name == "quanta" and draws.random() < 0.5:
            changed = (changed.astype(np.int64) * 0 + draws.choice((2**31 - 1, -(2**31), 10**6))).astype(np.int32)
        arrays[name] = changed
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)
    lines = _read_lines(run)
    for line in lines[1:]:
        if line.get("result", {}).get("id") == path.stem:
            line["recording"] = "sha256:" + sha256(path.read_bytes()).hexdigest()
    _sign(run, lines)


NAMES = (
    "results.json", "journal.jsonl", "report.md", "episodes", "episodes/s0.npz", "view", "view/index.html", "logs",
    "view/s0.html", "results-mdrive.json", "results-mdrive.tmp", "results.tmp", "transcript.jsonl", "transcripts",
    "cameras", "calls", "view/with-other",
)  # fmt: skip


def replace_file(run: Path, draws: random.Random) -> None:
    """Put a link, a device, a pipe, a folder, or a file without end in place of a file or a folder."""
    path = run / draws.choice(NAMES)
    if path.parent != run:
        path.parent.mkdir(exist_ok=True)
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.is_dir():
        shutil.rmtree(path)
    outside = run.parent / "outside"
    kinds: tuple[Callable[[], object], ...] = (
        lambda: path.symlink_to("/dev/zero"),
        lambda: path.symlink_to(outside / "keys"),
        lambda: path.symlink_to(outside),
        lambda: path.symlink_to(outside / "new"),
        lambda: path.symlink_to(path.name),
        lambda: os.mkfifo(path),
        lambda: path.mkdir(),
        lambda: path.write_bytes(b""),
        lambda: _make_sparse(path),
    )
    draws.choice(kinds)()


def _make_sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2**36)


CHANGES = (change_results, change_journal, change_everywhere, change_everywhere, change_recording, replace_file)


# ---------------------------------------------------------------- the commands


@dataclass
class RunHarness:
    """Makes hostile copies of a run and calls every command on them."""

    folder: Path

    def __post_init__(self) -> None:
        self.valid = make_valid_run(self.folder)
        self.other = shutil.copytree(self.valid, self.folder / "other")
        for name in ("results.json", "report.md"):
            path = self.other / name
            path.write_text(path.read_text().replace("stationary", "idm"))
        lines = json.loads(json.dumps(_read_lines(self.other)).replace("stationary", "idm"))
        _sign(self.other, lines)
        self.outside = self.folder / "outside"
        self.runs = self.commands = self.refused = 0
        self._runner = CliRunner()

    def list_commands(self, run: Path, out: Path) -> list[list[str]]:
        """Every command that reads a run folder."""
        a, b = str(run), str(self.other)
        return [
            ["compare", a, b],
            ["compare", b, a],
            ["report", a, b, "--out", str(out / "report")],
            ["rescore", a],
            ["rescore", a, "--score-mode", "hard"],
            ["show", a],
            ["show", a, "--out", str(out / "report.md")],
            ["list", "runs", str(run.parent)],
            ["view", a, "--no-open"],
            ["view", a, "--no-open", "--replays", "all"],
            ["view", a, b, "--no-open", "--replays", "all"],
            ["view", a, "--no-open", "--scenario", "s0"],
            ["verify", a],
            ["verify", a, "--sandbox"],
            ["render", a, "--scenario", "s0", "--out", str(out / "x.png"), "--size", "320x240"],
            ["export", a, "--format", "csv", "--out", str(out / "csv")],
            ["export", a, "--format", "mcap", "--out", str(out / "mcap")],
            ["export", a, "--format", "fcd", "--out", str(out / "fcd")],
            ["export", a, "--format", "openscenario", "--out", str(out / "osc")],
            ["eval", "--suite", str(self.folder / "suite"), "--agent", "stationary", "--out", a],
        ]

    def try_run(self, draws: random.Random, commands: int | None = None) -> None:
        """Make one hostile run and call commands on it. Raises AssertionError with what went wrong."""
        work = self.folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        shutil.rmtree(self.outside, ignore_errors=True)
        self.outside.mkdir()
        (self.outside / "keys").write_text("mine\n")
        out = work / "out"
        out.mkdir(parents=True)
        run = shutil.copytree(self.valid, work / "run")
        changes = draws.choices(CHANGES, k=draws.randint(1, 2))
        for change in sorted(changes, key=lambda one: one is replace_file):  # last: the others read what is there
            try:
                change(run, draws)
            except (OSError, ValueError, KeyError, IndexError, AttributeError, TypeError):
                continue  # the change before left nothing to change
        self.runs += 1
        chosen = self.list_commands(run, out)
        for command in chosen if commands is None else draws.sample(chosen, commands):
            self.call(command)
        with suppress(MdriveError):
            str(load_run(run))

    def call(self, command: list[str]) -> Result:
        """Call a command and check how it ended."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
            patch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
            patch.setattr("mdrive_sumo.runs.verify.ProcessPool", LocalExecutor)
            patch.setattr("mdrive_sumo.runs.verify.reexecute", lambda job: record_episode(job.scenario))
            ended = self._runner.invoke(command_line, command)
        self.commands += 1
        self.refused += ended.exit_code == 2
        place = " ".join(command)
        if ended.exception is not None and not isinstance(ended.exception, SystemExit):
            trace = "".join(traceback.format_exception(ended.exception))
            raise AssertionError(f"{place}\n{trace}")
        assert ended.exit_code in (0, 1, 2), f"{place}: exit code {ended.exit_code}\n{ended.output[-2000:]}"
        if ended.exit_code == 2:
            lines = [line for line in ended.stderr.splitlines() if line.startswith("Error: ")]
            assert len(lines) == 1, f"{place}: expected one sentence, found {ended.stderr[-2000:]!r}"
        shown = [character for character in SEEN if character in ended.output]
        assert not shown, f"{place}: {shown} reach the terminal: {ended.output[:2000]!r}"
        self._check_outside(place)
        self._check_files(Path(command[command.index("--out") + 1]) if "--out" in command else None, place)
        return ended

    def _check_outside(self, place: str) -> None:
        found = {path.name: path.read_text() for path in self.outside.iterdir()}
        assert found == {"keys": "mine\n"}, f"{place}: written through a link: {found}"

    def _check_files(self, out: Path | None, place: str) -> None:
        """Check what was written: no formulas in CSV, no images or links in Markdown, no script in pages."""
        if out is None or not out.is_dir():
            return
        for path in out.rglob("*.csv"):
            text = path.read_text()
            assert "\n=" not in text and ",=" not in text and ',"=' not in text, f"{place}: a formula in {path}"
        for path in out.rglob("*.md"):
            text = path.read_text()
            assert "://evil" not in text and not re.search(r"(?<!\\)\]\(http", text), f"{place}: a link in {path}"
        for path in out.rglob("*.html"):
            text = path.read_text()
            assert "<script>alert" not in text and "<img src=x" not in text, f"{place}: a script in {path}"


def main(arguments: list[str]) -> None:
    """Run the command line."""
    seconds, seed, folder = float(arguments[0]), int(arguments[1]), Path(arguments[2])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    harness, draws = RunHarness(folder), random.Random(f"runs {seed}")
    found: dict[str, str] = {}
    stop = time.monotonic() + seconds
    while time.monotonic() < stop:
        try:
            harness.try_run(draws)
        except AssertionError as error:
            text = str(error)
            key = text.strip().splitlines()[-1][:80] if "Traceback" in text else text[:80]
            if key not in found:
                found[key] = text
                shutil.rmtree(folder / f"finding-{len(found)}", ignore_errors=True)
                (folder / "work").rename(folder / f"finding-{len(found)}")
    for i, text in enumerate(found.values(), 1):
        sys.stdout.write(f"=== finding {i}\n{text[:600]}\n ... {text[-2500:]}\n")
    sys.stdout.write(
        f"{harness.runs} runs, {harness.commands} commands, {harness.refused} refused, {len(found)} findings\n"
    )
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main(sys.argv[1:])
