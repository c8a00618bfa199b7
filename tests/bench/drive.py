"""People at the wheel, without pages: the clock under load, branches, scrubbing, many drives at a time, random actions.

    python tests/bench/drive.py              84 vehicles and two drivers, branches, motion
    python tests/bench/drive.py many [N]     N drives (10) of two drivers each at a time
    python tests/bench/drive.py random [N]   a drive of N random actions (1000) with kills, every take verified

Programs press the pedals, 20 inputs a second each. `many` wants 16 cores.
"""

import asyncio
import os
import random
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "bench")]  # `server` is the package, not the bench

from busy_grid import VEHICLES, busy_scenario, grid  # noqa: E402
from testing.drives import SCENARIO, DriveSession, list_group  # noqa: E402
from testing.random_drives import RandomDrive, check_takes  # noqa: E402
from testing.short_suite import make_short_suite  # noqa: E402

from mdrive_sumo.core.state import TICKS_PER_SECOND  # noqa: E402
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite  # noqa: E402
from server.drive.simulation_process import DriveSetup  # noqa: E402

DRIVEN_S = 20.0
LONG_TICKS = 60 * TICKS_PER_SECOND
"""A take of a minute."""
LONG_LIMIT_S = 120.0
BRANCHES = 20
Row = tuple[str, float, str, str]


def save_busy_suite(folder: Path) -> Path:
    """A suite with one scenario: two CAVs and 84 background vehicles on a grid, all of which decide in every tick."""
    (folder / "grid").mkdir()
    roads = grid(folder / "grid")
    scenario = busy_scenario(roads, 2, VEHICLES, 0.05)
    save_suite(Suite(SuiteFile(name="busy", title="Busy grid"), folder / "suite", (scenario,)))
    shutil.copytree(roads.folder, folder / "suite" / "networks" / "grid")
    return folder / "suite"


def make_busy_setup(suite: Path, folder: Path, **values: object) -> DriveSetup:
    settings = {"people": ("0", "1"), "suite": str(suite), **values}
    return DriveSetup(f"bench-2-{VEHICLES}", folder, **settings)  # pyright: ignore[reportArgumentType]


def processor_s(pid: int) -> float:
    """Processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def private_mb(pid: int) -> float:
    """Memory that a process shares with no other one [MB]."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) / 1000


async def measure_clock(session: DriveSession, seconds: float) -> tuple[float, float, float]:
    """Drive; return simulated by real time, the 95th percentile of the time between frames [s], and processor time a
    simulated second of all processes of the drive [s].
    """
    await session.process.resume()
    await session.drive_on(TICKS_PER_SECOND)
    before = {pid: processor_s(pid) for pid in list_group(session.group)}
    first, begin = session.tick, time.monotonic()
    await asyncio.sleep(seconds)
    took_s, ticks = time.monotonic() - begin, session.tick - first
    used_s = sum(processor_s(pid) - before.get(pid, 0.0) for pid in list_group(session.group))
    times = session.frame_times[-ticks:]
    gaps = sorted(after - before for before, after in pairwise(times))
    await session.process.pause()
    return ticks / TICKS_PER_SECOND / took_s, gaps[int(0.95 * len(gaps))], used_s / (ticks / TICKS_PER_SECOND)


async def clock_rows(suite: Path, folder: Path) -> list[Row]:
    session = DriveSession()
    begin = time.monotonic()
    await session.open(make_busy_setup(suite, folder / "clock"))
    opened_s = time.monotonic() - begin
    factor, gap_s, used_s = await measure_clock(session, DRIVEN_S)
    checkpoints = [private_mb(pid) for pid in list_group(session.group) if pid != session.group]
    await session.close(0.0)
    return [
        (f"open a drive, 2 drivers + {VEHICLES} vehicles", opened_s, "s", ""),
        ("  simulated by real time", factor, "", ">= 0.99"),
        ("  time between frames, 95th percentile", gap_s * 1e3, "ms", "<= 60"),
        ("  processor time a simulated second", used_s, "s", "<= 1"),
        ("  memory of a checkpoint of its own, median", statistics.median(checkpoints), "MB", ""),
    ]


async def branch_rows(suite: Path, folder: Path) -> list[Row]:
    """Branches of a take of a minute: from checkpoints, then after the drive was closed and opened again."""
    chosen = random.Random(0)
    session = DriveSession(limit_s=LONG_LIMIT_S)
    place = folder / "branches"
    await session.open(make_busy_setup(suite, place, speed_up=1000.0))
    await session.drive_to(LONG_TICKS)
    await asyncio.sleep(1.0)  # frames that came faster than they were read are through
    begin = time.monotonic()
    motion = await session.process.load_motion(1)
    scrubbed_s, ticks = time.monotonic() - begin, session.tick
    fast: list[float] = []
    for _ in range(BRANCHES):
        begin = time.monotonic()
        await session.process.branch(1, chosen.randrange(ticks))
        fast.append(time.monotonic() - begin)
    begin = time.monotonic()
    await session.process.what_if(1, ticks // 2, ["sharing"], 5.0)
    looked_s = time.monotonic() - begin
    await session.close(0.0)
    slow: list[float] = []
    for _ in range(3):
        session = DriveSession()
        await session.open(make_busy_setup(suite, place, checkpoint_s=0.0))
        begin = time.monotonic()
        await session.process.branch(1, ticks - 1)
        slow.append(time.monotonic() - begin)
        await session.close(0.0)
    return [
        (f"motion of a take of {ticks / TICKS_PER_SECOND:.0f} s, from the process", scrubbed_s * 1e3, "ms", "<= 100"),
        ("  its size", len(motion) / 1e6, "MB", ""),
        (f"branch with checkpoints, median of {BRANCHES}", statistics.median(fast), "s", "<= 0.5"),
        ("  the slowest", max(fast), "s", "<= 0.5"),
        ("branch without checkpoints, the last tick, median of 3", statistics.median(slow), "s", "<= 5"),
        ("what-if branch of 5 s", looked_s, "s", ""),
    ]


async def many_rows(suite: Path, folder: Path, count: int) -> list[Row]:
    """Drives at a time, two drivers each."""
    sessions = [DriveSession() for _ in range(count)]
    setups = [make_busy_setup(suite, folder / f"many{number}") for number in range(count)]
    await asyncio.gather(*(session.open(setup) for session, setup in zip(sessions, setups, strict=True)))
    measured = await asyncio.gather(*(measure_clock(session, DRIVEN_S) for session in sessions))
    await asyncio.gather(*(session.close(0.0) for session in sessions))
    factors, gaps, used = zip(*measured, strict=True)
    return [
        (
            f"{2 * count} drivers in {count} drives on {os.cpu_count()} cores, the slowest clock",
            min(factors),
            "",
            ">= 0.99",
        ),
        ("  time between frames, 95th percentile, the worst", max(gaps) * 1e3, "ms", "<= 60"),
        ("  processor time a simulated second, mean", statistics.mean(used), "s", ""),
    ]


def random_rows(folder: Path, count: int) -> Iterator[Row]:
    suite = make_short_suite(folder / "short", SCENARIO, metres=25)
    setup = DriveSetup(SCENARIO, folder / "random", suite=str(suite), people=("0", "1"), speed_up=1000.0)
    drive, begin = RandomDrive(setup, count), time.monotonic()
    drive.run()
    yield f"{count} random actions, {drive.done['rewind']} rewinds", time.monotonic() - begin, "s", ""
    yield f"  of {drive.done['kill']} kills, lost actions", len(drive.lost), "", "0"
    yield "  takes that equal their parent and verify", len(check_takes(folder / "random").takes), "", "all"


def main() -> None:
    what, count = (sys.argv[1:2] or [""])[0], int((sys.argv[2:3] or ["0"])[0])
    with tempfile.TemporaryDirectory(prefix="mdrive-drive-") as name:
        folder = Path(name)
        if what == "random":
            show(random_rows(folder, count or 1000))
        elif what == "many":
            show(asyncio.run(many_rows(save_busy_suite(folder), folder, count or 10)))
        else:
            suite = save_busy_suite(folder)
            show(asyncio.run(clock_rows(suite, folder)))
            show(asyncio.run(branch_rows(suite, folder)))


def show(rows: Iterable[Row]) -> None:
    for text, value, unit, target in rows:
        sys.stdout.write(f"{text:<64} {value:9.3f} {unit:<3} {target}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
