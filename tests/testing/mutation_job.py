"""`make mutants`: does the room's testing notice small changes of its source? CONTRIBUTING.md has its command.

Every mutant runs in one process, on a copy of the tree; the tree itself is never changed. The tests that execute the
changed line come first; a mutant that they do not notice is shown to all tests of the room.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue

import click
import coverage
import pytest

from hatch_build import LAYER
from mdrive_sumo.core.compiled import SWITCH
from testing.mutants import Mutant, list_mutants, sample_mutants

ROOT = Path(__file__).resolve().parents[2]
SURVIVORS = ROOT / "tests" / "mutation" / "survivors.toml"
LEAST_SHARE = 0.9
"""Of the sampled mutants of a room that have to be noticed: some changes are equivalent, which no test can tell."""
SEED = 1
SAMPLE = 40
"""Mutants of a room."""
CPU_LIMIT_S = 60
"""Processor time of a mutant's tests: four times that of the slowest room. A mutant that loops is noticed."""
TIMES_FILE = "MUTATION_TIMES"
"""Environment variable: where the plug-in below writes how long each test takes."""


@dataclass(frozen=True)
class Room:
    """Modules, and the tests that have to notice their changes; patterns relative to the tree."""

    sources: tuple[str, ...]
    tests: tuple[str, ...]


ROOMS: Mapping[str, Room] = {
    "scoring": Room(("mdrive_sumo/scoring/**/*.py",), ("tests/mdrive_sumo/scoring",)),
    "contact": Room(
        ("mdrive_sumo/vehicle/contact.py", "mdrive_sumo/vehicle/impact.py"),
        ("tests/mdrive_sumo/vehicle", "tests/mdrive_sumo/loop/test_contact_order.py"),
    ),
    "channel": Room(
        ("mdrive_sumo/v2x/channel.py", "mdrive_sumo/v2x/comm_settings.py", "mdrive_sumo/v2x/message_counts.py"),
        ("tests/mdrive_sumo/v2x",),
    ),
    "loop": Room(("mdrive_sumo/loop/**/*.py",), ("tests/mdrive_sumo/loop",)),
    "match": Room(("real2sim/match/**/*.py",), ("tests/real2sim/match", "tests/real2sim/authored/test_authored.py")),
}


# --- a plug-in of pytest, in the processes of the tests -----------------------------------------------------------

_times: dict[str, float] = {}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up how long a test and its fixtures take."""
    _times[report.nodeid] = _times.get(report.nodeid, 0.0) + report.duration


def pytest_sessionfinish() -> None:
    """Write the durations [s] of all tests, if the job asks for them."""
    if path := os.environ.get(TIMES_FILE):
        Path(path).write_text(json.dumps(_times))


# --- copies of the tree -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TreeCopy:
    """A copy of the tree in which one mutant at a time is tested."""

    folder: Path

    def run_tests(self, arguments: Sequence[str], **environment: str) -> tuple[int, str]:
        """Return exit status and output of pytest; the status is negative if a limit has ended it."""
        paths = os.pathsep.join((str(self.folder), str(self.folder / "tests")))
        kept = {key: value for key, value in os.environ.items() if key != "MDRIVE_STRICT_SKIPS"}
        command = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-x", "-m", "not full", "-p", "no:cacheprovider"]
        process = subprocess.Popen(
            [*command, *arguments],
            cwd=self.folder,
            # Mutants are of the Python text; tests of twins compare it with the compiled layer all the same.
            env={**kept, "PYTHONPATH": paths, "TESTS_PROFILE": "mutants", SWITCH: "off", **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=_limit_processor_time,
        )
        try:
            output, _ = process.communicate(timeout=10 * CPU_LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
        return process.returncode, output

    def write(self, path: str, source: bytes) -> None:
        """Replace a module, and forget what Python has compiled of it: its time stamps are whole seconds."""
        file = self.folder / path
        file.write_bytes(source)
        for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            compiled.unlink()


def _limit_processor_time() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT_S, CPU_LIMIT_S + 5))


def copy_tree(source: Path, folder: Path) -> TreeCopy:
    """Copy all files that git tracks or would track, and the compiled layer."""
    names = subprocess.run(
        ["git", "ls-files", "-coz", "--exclude-standard"], cwd=source, check=True, capture_output=True
    ).stdout
    there = b"\0".join(name for name in names.split(b"\0") if name and (source / os.fsdecode(name)).is_file())
    folder.mkdir()
    packed = subprocess.run(
        ["tar", "c", "--null", "-T", "-"], cwd=source, input=there, check=True, capture_output=True
    ).stdout
    subprocess.run(["tar", "x"], cwd=folder, input=packed, check=True)
    if (source / LAYER).is_file():
        (folder / LAYER).write_bytes((source / LAYER).read_bytes())
    return TreeCopy(folder)


# --- which tests, and what they say -------------------------------------------------------------------------------


@dataclass(frozen=True)
class RoomTests:
    """The tests of a room and what they execute, found by running all of them on the unchanged source."""

    room: Room
    seconds: Mapping[str, float]
    """By test."""
    tests_by_line: Mapping[tuple[str, int], tuple[str, ...]]

    def list_first(self, mutant: Mutant) -> list[str]:
        """Return the tests that execute the changed line, the quick ones first; empty for what runs at import."""
        return sorted(self.tests_by_line.get((mutant.path, mutant.line), ()), key=lambda test: self.seconds[test])


def measure_room(room: Room, tree: TreeCopy) -> RoomTests:
    """Run all tests of a room; raise `click.ClickException` if one fails without any change."""
    times, data = tree.folder / "times.json", tree.folder / "coverage.data"
    status, output = tree.run_tests(
        ["-p", "testing.mutation_job", "--cov", "--cov-context=test", "--cov-report=", *room.tests],
        **{TIMES_FILE: str(times), "COVERAGE_FILE": str(data)},
    )
    if status != 0:
        raise click.ClickException(f"the tests fail on the unchanged source:\n{output[-3000:]}")
    executed = coverage.CoverageData(str(data))
    executed.read()
    seconds: dict[str, float] = json.loads(times.read_text())
    lines: dict[tuple[str, int], tuple[str, ...]] = {}
    for file in find_sources(room, tree.folder):
        for line, contexts in executed.contexts_by_lineno(str(file)).items():
            tests = {context.partition("|")[0] for context in contexts} & set(seconds)
            lines[file.relative_to(tree.folder).as_posix(), line] = tuple(sorted(tests))
    return RoomTests(room, seconds, lines)


def find_sources(room: Room, root: Path) -> list[Path]:
    """Return the modules of a room."""
    return sorted({file for pattern in room.sources for file in root.glob(pattern)})


def is_noticed(mutant: Mutant, tests: RoomTests, tree: TreeCopy) -> bool:
    """Return whether a test fails with the mutant, or does not end."""
    unchanged = (tree.folder / mutant.path).read_bytes()
    tree.write(mutant.path, mutant.apply(unchanged))
    try:
        first = tests.list_first(mutant)
        if first:
            names = tree.folder / "names.txt"
            names.write_text("\n".join(first))
            status, _ = tree.run_tests([f"@{names}"])
            if status not in (0, pytest.ExitCode.USAGE_ERROR):  # names of tests may depend on the source
                return True
        status, _ = tree.run_tests(tests.room.tests)
        return status != 0
    finally:
        tree.write(mutant.path, unchanged)


@dataclass
class RoomVerdict:
    """How the tests of one room did."""

    sampled: list[Mutant]
    survivors: list[Mutant] = field(default_factory=list[Mutant])

    @property
    def share(self) -> float:
        """Share of the sampled mutants that were noticed."""
        return 1 - len(self.survivors) / max(len(self.sampled), 1)


def judge_room(tests: RoomTests, sampled: Sequence[Mutant], trees: Sequence[TreeCopy]) -> RoomVerdict:
    """Test the mutants, as many at a time as there are copies of the tree."""
    free: SimpleQueue[TreeCopy] = SimpleQueue()
    for tree in trees:
        free.put(tree)
    verdict, lock = RoomVerdict(list(sampled)), threading.Lock()

    def judge(mutant: Mutant) -> None:
        tree = free.get()
        try:
            noticed = is_noticed(mutant, tests, tree)
        finally:
            free.put(tree)
        with lock:
            if not noticed:
                verdict.survivors.append(mutant)
                click.echo(f"  survives: {mutant.name}  (line {mutant.line})")

    with ThreadPoolExecutor(len(trees)) as pool:
        for done in [pool.submit(judge, mutant) for mutant in sampled]:
            done.result()
    return verdict


# --- the list of survivors, and the command -----------------------------------------------------------------------


def read_survivors(path: Path = SURVIVORS) -> dict[str, str]:
    """Return the reasons why mutants may survive, by name."""
    listed = tomllib.loads(path.read_text())["survivor"]
    reasons = {one["mutant"]: one["reason"] for one in listed}
    if len(reasons) != len(listed) or not all(reasons.values()):
        raise click.ClickException(f"{path.name}: expected each mutant once, and a reason for each")
    return reasons


def find_problems(verdicts: Mapping[str, RoomVerdict], reasons: Mapping[str, str], existing: set[str]) -> Iterator[str]:
    """Yield a sentence for everything that fails the job."""
    sampled = {mutant.name for verdict in verdicts.values() for mutant in verdict.sampled}
    survivors = {mutant.name for verdict in verdicts.values() for mutant in verdict.survivors}
    for name in sorted(survivors - set(reasons)):
        yield f"survives, and is not in {SURVIVORS.name}: {name}"
    for name in sorted(set(reasons) & (sampled - survivors)):
        yield f"is in {SURVIVORS.name}, but a test notices it: {name}"
    for name in sorted(set(reasons) - existing):
        yield f"is in {SURVIVORS.name}, but the source has no such text: {name}"
    for room, verdict in verdicts.items():
        if verdict.share < LEAST_SHARE:
            yield f"{room}: {verdict.share:.0%} of the mutants are noticed, expected at least {LEAST_SHARE:.0%}"


def list_existing(rooms: Iterable[Room] = ROOMS.values(), root: Path = ROOT) -> set[str]:
    """Return the names of all mutants of all rooms."""
    return {mutant.name for room in rooms for mutant in list_mutants(root, find_sources(room, root))}


@click.command()
@click.option("--room", "names", multiple=True, type=click.Choice(tuple(ROOMS)), help="Only this room; repeatable.")
@click.option("--mutants", "count", default=SAMPLE, show_default=True, help="Mutants sampled of each room.")
@click.option("--skip", default=0, help="Leave out so many of the sample: for a run in pieces.")
@click.option("--seed", default=SEED, show_default=True, help="Of the sample.")
@click.option("--jobs", default=2, show_default=True, help="Mutants tested at a time.")
def main(names: tuple[str, ...], count: int, skip: int, seed: int, jobs: int) -> None:
    """Change the source of some rooms in many small ways, in copies: the tests of the room have to notice."""
    verdicts: dict[str, RoomVerdict] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        trees = [copy_tree(ROOT, Path(scratch) / f"{i}") for i in range(jobs)]
        for name in names or ROOMS:
            mutants = list_mutants(ROOT, find_sources(ROOMS[name], ROOT))
            sampled = sample_mutants(mutants, count, seed)[skip:]
            click.echo(f"{name}: {len(sampled)} of {len(mutants)} mutants")
            verdicts[name] = judge_room(measure_room(ROOMS[name], trees[0]), sampled, trees)
    click.echo(f"\n{'room':<10}{'sampled':>9}{'noticed':>9}{'share':>8}")
    for name, verdict in verdicts.items():
        noticed = len(verdict.sampled) - len(verdict.survivors)
        click.echo(f"{name:<10}{len(verdict.sampled):>9}{noticed:>9}{verdict.share:>8.1%}")
    problems = list(find_problems(verdicts, read_survivors(), list_existing()))
    for problem in problems:
        click.echo(problem)
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
