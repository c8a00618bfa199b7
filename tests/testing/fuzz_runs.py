"""Hostile run folders, as strangers may send them, fed to every command that reads one.

`python -m testing.fuzz_runs SECONDS SEED FOLDER` tries for some seconds; it ends with the exit code 0, or with another
one and the run in FOLDER/finding. No tests in here.
"""

import json
import random
import re
import resource
import shutil
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.api.run import load_run
from mdrive_sumo.cli import main as command_line
from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import MdriveError
from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame, save_episode
from mdrive_sumo.runs.episode_job import EpisodeJob, score_job_episode
from mdrive_sumo.scoring import ScenarioResult
from testing import suite_fakes
from testing.fuzz_process import MEMORY_BYTES
from testing.hostile_runs import CHANGES, read_lines, replace_file, sign
from testing.local_executor import LocalExecutor

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
        lines = json.loads(json.dumps(read_lines(self.other)).replace("stationary", "idm"))
        sign(self.other, lines)
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
            ["export", a, "--format", "pcap", "--out", str(out / "pcap")],
            ["study", "agreements", a],
            ["study", "channel", a, b, "--out", str(out / "channel")],
            ["eval", "--suite", str(run.parent / "suite"), "--agent", "stationary", "--out", a],
        ]

    def copy_run(self) -> Path:
        """A new copy of the valid run with its suite and an empty folder `out` beside it, and a file outside of all.

        A run names its suite relative to itself: without it most commands would look at nothing else.
        """
        work = self.folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        shutil.rmtree(self.outside, ignore_errors=True)
        self.outside.mkdir()
        (self.outside / "keys").write_text("mine\n")
        (work / "out").mkdir(parents=True)
        shutil.copytree(self.folder / "suite", work / "suite")
        return shutil.copytree(self.valid, work / "run")

    def try_run(self, draws: random.Random, commands: int | None = None) -> None:
        """Make one hostile run and call commands on it. Raises AssertionError with what went wrong."""
        run = self.copy_run()
        changes = draws.choices(CHANGES, k=draws.randint(1, 2))
        for change in sorted(changes, key=lambda one: one is replace_file):  # last: the others read what is there
            try:
                change(run, draws)
            except (OSError, ValueError, KeyError, IndexError, AttributeError, TypeError):
                continue  # the change before left nothing to change
        self.runs += 1
        chosen = self.list_commands(run, run.parent / "out")
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
        if out is None or not out.is_dir() or out.parent.name != "out":
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
