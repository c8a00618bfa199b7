"""Two boxes tell each other nothing, whether they live at the same time or not; without boxes, the same programs do."""

import fcntl
import json
import os
import platform
import random
import shutil
import sys
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from testing.sampling import examples
from testing.sandbox_runs import AGENTS, PATIENCE_S, SMALL, needs_bubblewrap, own_slot, processes_of, reachable

from mdrive_sumo.agent_process.sandbox import Box, BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY, remove_idle_files
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID

pytestmark = [
    needs_bubblewrap,
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() != "x86_64", reason="needs x86-64"),
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root"),
]

SLOT = own_slot()
BITS = (0, 1, 1, 0, 1, 0, 0, 1, 0, 1)[: examples(4, 10)]
"""Tries: as many of both."""
CHANNELS = (
    *("record lock", "open file lock", "flock", "lock of a device", "inotify", "aio-nr"),
    *("residency by mincore", "residency by cachestat", "residency by RWF_NOWAIT", "residency by time"),
    *("residency by readahead", "futex", "shared pages", "times of a device", "memory of the host"),
    *(f"inode of a pipe{how}" for how in ("", " by fstatat", " by fstatat with high bits", " by statx")),
    *(f"inode of a pipe by {how}" for how in ("a link of /proc", "a path of /dev", "fdinfo", "a race")),
    *("inode of a socket", "inode of a memory file", "inode of shared memory", "inode in /proc"),
    *("inode of a process descriptor", "number of a process", "cookie of a socket", "key of shared memory"),
    *("inode of a file in memory", "inode of a file in memory by path"),
)
NUMBERS = CHANNELS[CHANNELS.index("inode of a pipe") :]
"""That the kernel counts, and that outlive who had them counted."""
LOOKS = 3
"""Other work on the machine disturbs one look: it opens a closed channel, or hides what an open one carries."""
STEP = 600
"""A number has moved if it differs by more; half of what `relay` makes for a bit."""
MOVED_BY_OTHERS = {
    *("inode of a process descriptor", "number of a process"),
    *("inode of a file in memory", "inode of a file in memory by path"),
}
"""What other work on the machine moves as much, between the lives of two boxes."""
NOISY = {
    *("memory of the host", "aio-nr", "inode of a pipe by a race"),
    *("residency by time", "residency by readahead", "residency by RWF_NOWAIT"),
}
"""Other work on the machine disturbs them, so that it is not required that they work without boxes."""
NEEDS_GVISOR = pytest.mark.skipif(shutil.which("runsc") is None, reason="needs gVisor's runsc")
BOUND = {"futex", "shared pages"}
"""Open as long as boxes see the same files, whatever calls are refused."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that all boxes are shown, on a disk so that its pages can be dropped."""
    path = tmp_path_factory.mktemp("shared") / "file"
    path.write_bytes(random.Random(0).randbytes(1 << 20))
    with path.open("rb") as file:
        os.fsync(file)
    path.chmod(0o644)
    reachable(path.parent)
    return path


@pytest.fixture(autouse=True)
def _alone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One test of this file at a time: what one sends without a box, another of a second worker would see."""
    folder = tmp_path_factory.getbasetemp().parent  # that of all workers
    with (folder / "channels.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


class Program:
    """One that obeys, see `hostile/agents/relay.py`."""

    def __init__(self, box: Box) -> None:
        box.socket.settimeout(PATIENCE_S)
        self._box = box
        self._lines = box.socket.makefile("rw")
        self.ask("rest flock")  # it has begun

    def ask(self, words: str) -> object:
        self._lines.write(words + "\n")
        self._lines.flush()
        line = self._lines.readline()
        assert line, self._box.log().decode(errors="replace")
        return json.loads(line)


class Pair:
    """A sending and a receiving program that live at the same time."""

    def __init__(self, sender: Box, receiver: Box) -> None:
        self._programs = {"send": Program(sender), "read": Program(receiver)}
        for box in (sender, receiver):
            put_on_one_processor(box)

    def _ask(self, side: str, words: str) -> object:
        return self._programs[side].ask(words)

    def carry(self, channel: str, bit: int) -> str:
        """What the receiver sees when this bit is sent."""
        self._ask("read", f"arm {channel}")
        self._ask("send", f"send {bit} {channel}")
        seen = self._ask("read", f"read {channel}")
        self._ask("send", f"rest {channel}")
        return json.dumps(seen)


def put_on_one_processor(box: Box) -> None:
    """Some numbers are counted for each processor: the most that a scheduler can do for two boxes."""
    for pid in processes_of(FIRST_UID + box.slot):
        with suppress(ProcessLookupError):
            os.sched_setaffinity(pid, {min(os.sched_getaffinity(0))})


def find_interpreter() -> tuple[str, dict[Path, str]]:
    """The system's if there is one: its copy is small."""
    if Path("/usr/bin/python3").exists():
        return str(Path("/usr/bin/python3").resolve()), {}
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    return f"/opt/python/bin/{name}", {Path(sys.base_prefix): "/opt/python"}


def make_spec(shared: Path, slot: int, **more: Any) -> BoxSpec:
    path = str(shared) if more.get("backend") == "none" else "/shared/file"
    python, folder = find_interpreter()
    readonly = {AGENTS: "/agent", shared.parent: "/shared", **folder}
    return BoxSpec((python, "/agent/relay.py", path), readonly, slot=slot, limits=SMALL, **more)


@contextmanager
def open_pair(shared: Path, **more: Any) -> Iterator[Pair]:
    with ExitStack() as stack:
        yield Pair(*(stack.enter_context(open_box(make_spec(shared, SLOT + i, **more))) for i in range(2)))


def carry_in_turns(shared: Path, **more: Any) -> dict[str, dict[int, list[tuple[object, object]]]]:
    """What receivers saw before and after bits whose senders had ended, by channel and bit."""
    found = {channel: {0: list[tuple[object, object]](), 1: list[tuple[object, object]]()} for channel in CHANNELS}
    last = read_all(shared, **more)
    for bit in BITS:
        with open_box(make_spec(shared, SLOT, **more)) as box:
            program = Program(box)
            put_on_one_processor(box)
            for channel in CHANNELS:
                program.ask(f"send {bit} {channel}")
        now = read_all(shared, **more)
        for channel, seen in now.items():
            found[channel][bit].append((last[channel], seen))
        last = now
    return found


def read_all(shared: Path, **more: Any) -> dict[str, object]:
    with open_box(make_spec(shared, SLOT + 1, **more)) as box:
        program = Program(box)
        put_on_one_processor(box)
        return {channel: program.ask(f"read {channel}") for channel in CHANNELS}


def find_moved_numbers(found: dict[str, dict[int, list[tuple[object, object]]]]) -> set[str]:
    """The numbers that differ by more than a box makes itself."""
    rows = {channel: (*seen[0], *seen[1]) for channel, seen in found.items() if channel in NUMBERS}
    return {
        channel
        for channel, pairs in rows.items()
        for before, now in pairs
        if type(before) is not type(now) or (type(now) is int and type(before) is int and abs(now - before) > STEP)
    }


def find_carrying_numbers(found: dict[str, dict[int, list[tuple[object, object]]]]) -> set[str]:
    """The numbers that bits that are set move further than the others, by the median: other work moves some of both."""
    steps = {
        channel: [
            [now - before for before, now in seen[bit] if type(now) is int and type(before) is int] for bit in (0, 1)
        ]
        for channel, seen in found.items()
    }
    return {
        channel for channel, (zeros, ones) in steps.items() if zeros and ones and median(ones) - median(zeros) > STEP
    }


def find_open_channels(pair: Pair, channels: Collection[str] = CHANNELS) -> dict[str, dict[int, set[str]]]:
    """The channels through which the receiver saw different things for different bits."""
    seen = {channel: {0: set[str](), 1: set[str]()} for channel in channels}
    for channel in channels:
        for bit in BITS:
            seen[channel][bit].add(pair.carry(channel, bit))
    return {channel: found for channel, found in seen.items() if found[0] != found[1]}


def confirm_open_channels(pair: Pair) -> set[str]:
    """The channels that are found open three times: once is what other work on the machine does to the noisy ones."""
    found = set(find_open_channels(pair))
    for _ in range(LOOKS - 1):
        found &= set(find_open_channels(pair, found))
    return found


@pytest.mark.parametrize("backend", ["bubblewrap", pytest.param("gvisor", marks=NEEDS_GVISOR)])
def test_boxes_that_live_together_exchange_no_bit(backend: str, shared: Path) -> None:
    with open_pair(shared, backend=backend, copies=MEMORY) as pair:
        assert confirm_open_channels(pair) == set()
    remove_idle_files(MEMORY, (SLOT, SLOT + 1))


@pytest.mark.full
@pytest.mark.parametrize("backend", ["bubblewrap", pytest.param("gvisor", marks=NEEDS_GVISOR)])
def test_boxes_that_follow_each_other_exchange_no_bit(backend: str, shared: Path) -> None:
    found = carry_in_turns(shared, backend=backend, copies=MEMORY)
    last = {channel: tuple({str(now) for _, now in seen[bit]} for bit in (0, 1)) for channel, seen in found.items()}
    assert {channel: pair for channel, pair in last.items() if channel not in NUMBERS and pair[0] != pair[1]} == {}
    assert find_moved_numbers(found) == set()
    remove_idle_files(MEMORY, (SLOT, SLOT + 1))


def test_boxes_that_share_files_have_no_lock_watch_or_residency(shared: Path) -> None:
    with open_pair(shared) as pair:
        assert confirm_open_channels(pair) <= BOUND


def test_without_boxes_every_channel_carries_every_bit(shared: Path) -> None:
    missing = set(CHANNELS) - NOISY
    with open_pair(shared, backend="none") as pair:
        for _ in range(LOOKS):
            missing -= find_clear_channels(find_open_channels(pair, [name for name in CHANNELS if name in missing]))
    assert missing == set()


@pytest.mark.full
def test_without_boxes_every_number_carries_the_bits_of_a_sender_that_has_ended(shared: Path) -> None:
    missing = set(NUMBERS) - NOISY - MOVED_BY_OTHERS
    for _ in range(LOOKS):
        if missing:
            missing -= find_carrying_numbers(carry_in_turns(shared, backend="none"))
    assert missing == set()


def find_clear_channels(found: dict[str, dict[int, set[str]]]) -> set[str]:
    return {channel for channel, (zero, one) in ((c, f.values()) for c, f in found.items()) if not zero & one}
