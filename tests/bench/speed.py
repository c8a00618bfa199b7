"""Compare the processor time of a tick with that of a stored commit, in interleaved runs on this machine.

python tests/bench/speed.py                      the table of `make bench`
python tests/bench/speed.py --limit-s 120 --most 1.1     exit status 1 if a tick got more than 10 % slower

The old commit is unpacked from this clone into a scratch folder, and its compiled layer is built there. One process for
each of the two drives the same episodes in turn, so that other programs of the machine hinder both; what counts are
processor time and, where the machine counts them, instructions.
"""

import argparse
import ctypes
import importlib
import io
import json
import math
import os
import statistics
import struct
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
COMMIT_FILE = Path(__file__).with_name("speed_commit")
"""The commit to compare with: that of the last release, or of a change that made ticks faster or slower on purpose."""
PARTS = ("mdrive_sumo", "networks", "real2sim", "hatch_build.py")
"""What of a commit drives episodes, and builds its compiled layer."""
EPISODES = (
    ("constant-speed", "i12_ins_sl_old_town"),
    ("constant-speed", "crossing_058"),
    ("idm", "roundabout_03"),
    ("sharing+negotiation", "i19_ins_sr_minor_road"),
)
"""Agent and scenario of `mdrive`: CAVs alone, a log with 80 road users, traffic, and all that agents plan and send."""
MIN_ROUNDS = 5
"""As many are driven in any case: ten seconds."""
STEADY_ROUNDS = 8
"""A slower tick has to show in so many rounds before it fails."""
ROUNDS = 20
SLOWER, GOOD, NOT_COMPARED = 1, 0, 0
"""Exit statuses. What cannot be measured fails nothing, and says so."""
Round = Sequence["tuple[Sample, Sample]"]
"""The samples of the new and the old commit, by episode."""


class Sample(NamedTuple):
    """One drive of an episode."""

    ticks: int
    cpu_s: float
    instructions: int | None
    digest: str


def main() -> int:
    """Measure, print the table, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", default=COMMIT_FILE.read_text().split()[0], help="the old one")
    parser.add_argument("--limit-s", type=float, default=math.inf, help="wall clock of the measurement")
    parser.add_argument("--most", type=float, help="ratio of processor times from which on it fails")
    parser.add_argument("--drive", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.drive:
        return drive_on_request()
    with tempfile.TemporaryDirectory() as scratch:
        if reason := unpack(options.commit, Path(scratch)):
            say(f"speed is not compared with {options.commit[:8]}: {reason}")
            return NOT_COMPARED
        rounds = measure(ROOT, Path(scratch), options.limit_s, options.most)
    return report(rounds, options.commit, options.most)


def unpack(commit: str, folder: Path) -> str:
    """Unpack a commit and build its layer; return why that is impossible, "" if it is not."""
    git = ("git", "-C", str(ROOT))
    if subprocess.run([*git, "cat-file", "-e", f"{commit}^{{commit}}"], capture_output=True).returncode:
        return "this clone does not have that commit; `git fetch --unshallow` brings it"
    wanted = subprocess.run([*git, "archive", commit, *PARTS], capture_output=True, check=True)
    with tarfile.open(fileobj=io.BytesIO(wanted.stdout)) as archive:
        archive.extractall(folder, filter="data")
    built = subprocess.run([sys.executable, "hatch_build.py"], cwd=folder, capture_output=True, text=True)
    if built.returncode:
        return built.stderr.strip().splitlines()[-1]
    asked = (sys.executable, "-c", "from mdrive_sumo.core.compiled.twins import PROBLEM; print(PROBLEM)")
    problem = subprocess.run(asked, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()
    if problem:  # ten times slower without it: whatever is compared with that passes
        sys.exit(f"expected the compiled layer of {commit[:8]}, found {problem}")
    return ""


def measure(new: Path, old: Path, limit_s: float, most: float | None) -> list[Round]:
    """Return the samples (new, old) of all episodes, round by round."""
    began = time.monotonic()
    rounds: list[Round] = []
    with ExitStack() as stack:
        drivers = [stack.enter_context(start_driver(tree)) for tree in (new, old)]
        for driver in drivers:  # imports, networks and caches are no part of a tick
            for episode in range(len(EPISODES)):
                ask(driver, episode)
        while len(rounds) < ROUNDS:
            turn = drivers if len(rounds) % 2 else drivers[::-1]
            samples = [{id(driver): ask(driver, episode) for driver in turn} for episode in range(len(EPISODES))]
            rounds.append([(one[id(drivers[0])], one[id(drivers[1])]) for one in samples])
            if time.monotonic() - began > limit_s or (most is not None and is_clear(rounds, most)):
                break
    return rounds


def is_clear(rounds: Sequence[Round], most: float) -> bool:
    """Return whether more rounds would change nothing: both measures agree, and a failure has shown often enough."""
    least, middle = compute_ratios(rounds)
    if len(rounds) >= MIN_ROUNDS and max(least, middle) <= (1 + most) / 2:
        return True
    return len(rounds) >= STEADY_ROUNDS and min(least, middle) > most


def compute_ratios(rounds: Sequence[Round]) -> tuple[float, float]:
    """Return new / old: of the least processor times, and the median of the ratios of rounds; means over episodes."""
    least, middle = zip(*(_compute_episode_ratios(list(one)) for one in zip(*rounds, strict=True)), strict=True)
    return statistics.geometric_mean(least), statistics.geometric_mean(middle)


def _compute_episode_ratios(samples: Sequence[tuple[Sample, Sample]]) -> tuple[float, float]:
    per_tick = [(new.cpu_s / new.ticks, old.cpu_s / old.ticks) for new, old in samples]
    least = min(new for new, _ in per_tick) / min(old for _, old in per_tick)
    return least, statistics.median(new / old for new, old in per_tick)


def report(rounds: list[Round], commit: str, most: float | None) -> int:
    """Print the table and the verdict; return the exit status."""
    say(f"processor time of a tick, least of {len(rounds)} rounds: this tree against {commit[:8]}")
    for (agent, scenario), samples in zip(EPISODES, zip(*rounds, strict=True), strict=True):
        new, old = (min(sample.cpu_s / sample.ticks for sample in side) * 1e3 for side in zip(*samples, strict=True))
        first_new, first_old = samples[0]
        counted = ""
        if first_new.instructions and first_old.instructions:
            share = first_new.instructions / first_new.ticks / (first_old.instructions / first_old.ticks)
            counted = f", instructions x {share:.3f}"
        changed = "" if first_new.digest == first_old.digest else ", another digest"
        say(f"  {agent:<20} {scenario:<24} {new:7.3f} ms, was {old:7.3f} ms: x {new / old:.3f}{counted}{changed}")
    least, middle = compute_ratios(rounds)
    say(f"  together x {least:.3f}; by the medians of neighbouring runs x {middle:.3f}")
    if most is None or min(least, middle) <= most:
        if most is not None and max(least, middle) > most:
            say(f"  more than x {most:g} by one of the two only: the machine is too busy to tell, nothing fails")
        return GOOD
    say(
        f"  expected at most x {most:g}: make it faster, or write the new commit and the reason into {COMMIT_FILE.name}"
    )
    return SLOWER


def start_driver(tree: Path) -> "subprocess.Popen[str]":
    """Start a process that drives episodes with the code of a tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, __file__, "--drive"],
        cwd=tree, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def ask(driver: "subprocess.Popen[str]", episode: int) -> Sample:
    """Let a driver drive an episode."""
    assert driver.stdin is not None
    assert driver.stdout is not None
    driver.stdin.write(f"{episode}\n")
    driver.stdin.flush()
    return Sample(*json.loads(driver.stdout.readline()))


def drive_on_request() -> int:
    """Drive the episodes that standard input names by number, and print a sample of each."""
    # Of the tree in PYTHONPATH: what a driver calls must be in both.
    job, agents = (importlib.import_module(f"mdrive_sumo.runs.{name}") for name in ("episode_job", "agent_spec"))
    package = Path(str(importlib.import_module("mdrive_sumo").__file__)).parent
    folder = (package / "scenarios" / "mdrive").resolve()  # season 0; the stored commit knows no names with seasons
    counter = open_instruction_counter()
    for line in sys.stdin:
        agent, scenario = EPISODES[int(line)]
        wanted = job.EpisodeJob(folder, scenario, agents.AgentSpec(agent))
        say(json.dumps(measure_job(job.run_job, wanted, counter)))
    return 0


def measure_job(run_job: Any, wanted: Any, counter: int | None) -> Sample:
    """Return the sample of one job."""
    before = read_instructions(counter)
    began = time.process_time()
    result = run_job(wanted)
    took = time.process_time() - began
    after = read_instructions(counter)
    counted = None if before is None or after is None else after - before
    return Sample(result.ticks, took, counted, result.digest)


PERF_EVENT_OPEN = 298
"""Number of the system call on x86-64, see syscalls(2)."""
USER_INSTRUCTIONS = struct.pack("IIQQQQQ", 0, 112, 1, 0, 0, 0, 1 << 5 | 1 << 6).ljust(112, b"\0")
"""perf_event_attr: hardware event 1 of this process, without the kernel and a hypervisor; see perf_event_open(2)."""


def open_instruction_counter() -> int | None:
    """Return a descriptor that counts instructions of this process; None where there is none."""
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        return None
    descriptor = ctypes.CDLL(None).syscall(PERF_EVENT_OPEN, USER_INSTRUCTIONS, 0, -1, -1, 0)
    return descriptor if descriptor >= 0 else None


def read_instructions(counter: int | None) -> int | None:
    """Return the number of instructions so far."""
    return None if counter is None else struct.unpack("Q", os.read(counter, 8))[0]


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
