"""Two boxes tell each other nothing, whether they live at the same time or not; without boxes, the same programs do."""

import json
import os
import platform
import random
import shutil
import sys
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from testing.sandbox_runs import AGENTS, PATIENCE_S, SMALL, needs_bubblewrap, own_slot, processes_of, reachable

from mdrive_sumo.agent_process.sandbox import Box, BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.layers import find_program
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY, remove_idle_files
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from mdrive_sumo.core.errors import InputError

pytestmark = [
    needs_bubblewrap,
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() != "x86_64", reason="needs x86-64"),
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root"),
]

SLOT = own_slot()
BITS = (0, 1, 1, 0, 1, 0, 0, 1, 0, 1)
"""Ten tries."""
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
STEP = 600
"""A number has moved if it differs by more; half of what `relay` makes for a bit."""
OF_PROCESSES = {"inode of a process descriptor", "number of a process"}
"""What other work on the machine moves as much, between the lives of two boxes."""
NOISY = {"memory of the host", "residency by time", "residency by readahead", "residency by RWF_NOWAIT"} | {
    "inode of a pipe by a race"
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


def carry_in_turns(shared: Path, **more: Any) -> dict[str, dict[int, set[str]]]:
    """What receivers saw of bits whose senders had ended before, by channel and bit; numbers as whether they moved."""
    found = {channel: {0: set[str](), 1: set[str]()} for channel in CHANNELS}
    last = read_all(shared, **more)
    for bit in BITS:
        with open_box(make_spec(shared, SLOT, **more)) as box:
            program = Program(box)
            put_on_one_processor(box)
            for channel in CHANNELS:
                program.ask(f"send {bit} {channel}")
        now = read_all(shared, **more)
        for channel, seen in now.items():
            found[channel][bit].add(describe_change(last[channel], seen))
        last = now
    return found


def read_all(shared: Path, **more: Any) -> dict[str, object]:
    with open_box(make_spec(shared, SLOT + 1, **more)) as box:
        program = Program(box)
        put_on_one_processor(box)
        return {channel: program.ask(f"read {channel}") for channel in CHANNELS}


def describe_change(before: object, now: object) -> str:
    if type(now) is int and type(before) is int:
        return "moved" if abs(now - before) > STEP else "still"
    return json.dumps(now)


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
    for _ in range(2):
        found &= set(find_open_channels(pair, found))
    return found


@pytest.mark.parametrize("backend", ["bubblewrap", pytest.param("gvisor", marks=NEEDS_GVISOR)])
def test_boxes_that_live_together_exchange_no_bit(backend: str, shared: Path) -> None:
    with open_pair(shared, backend=backend, copies=MEMORY) as pair:
        assert confirm_open_channels(pair) == set()
    remove_idle_files(MEMORY, (SLOT, SLOT + 1))


@pytest.mark.parametrize("backend", ["bubblewrap", pytest.param("gvisor", marks=[NEEDS_GVISOR, pytest.mark.full])])
def test_boxes_that_follow_each_other_exchange_no_bit(backend: str, shared: Path) -> None:
    found = carry_in_turns(shared, backend=backend, copies=MEMORY)
    assert {channel: seen for channel, seen in found.items() if seen[0] != seen[1]} == {}
    assert not {channel for channel in NUMBERS if "moved" in found[channel][1]}
    remove_idle_files(MEMORY, (SLOT, SLOT + 1))


def test_boxes_that_share_files_have_no_lock_watch_or_residency(shared: Path) -> None:
    with open_pair(shared) as pair:
        assert confirm_open_channels(pair) <= BOUND


def test_without_boxes_every_channel_carries_every_bit(shared: Path) -> None:
    with open_pair(shared, backend="none") as pair:
        found = find_open_channels(pair)
    assert find_clear_channels(found) >= set(CHANNELS) - NOISY, found


def test_without_boxes_every_number_carries_every_bit_when_its_sender_has_ended(shared: Path) -> None:
    found = carry_in_turns(shared, backend="none")
    assert find_clear_channels(found) >= set(NUMBERS) - NOISY - OF_PROCESSES, found


def find_clear_channels(found: dict[str, dict[int, set[str]]]) -> set[str]:
    return {channel for channel, (zero, one) in ((c, f.values()) for c, f in found.items()) if not zero & one}


def test_a_slots_copies_are_kept_for_the_next_box_and_renewed_with_the_files(tmp_path: Path) -> None:
    agent = reachable(tmp_path) / "agent"
    agent.mkdir()
    (agent / "text").write_text("one")
    place = tmp_path / "copies"
    place.mkdir()
    spec = BoxSpec(("/bin/sh", "-c", "cat /agent/text"), {agent: "/agent"}, slot=SLOT, copies=place, limits=SMALL)

    def look() -> tuple[bytes, set[int]]:
        with open_box(spec) as box:
            box.ready(PATIENCE_S)
            box.close()
        return box.log(), {path.stat().st_ino for path in place.rglob("cat")}

    first, again = look(), look()
    assert first == again == (b"one", first[1])
    assert (agent / "text").stat().st_ino not in {path.stat().st_ino for path in place.rglob("text")}
    (agent / "text").unlink()
    (agent / "text").write_text("two, longer")
    assert look()[0] == b"two, longer"
    remove_idle_files(place)
    assert [path.name for path in place.rglob("*")] == ["mdrive-sumo-files-0"]


def test_files_of_one_folder_are_one_mount_unless_something_else_is_mounted_there(tmp_path: Path) -> None:
    """Each mount costs the box's start; a mount inside a read-only one would fail."""
    shown, place = reachable(tmp_path) / "shown", tmp_path / "copies"
    place.mkdir()
    for name in ("a", "b", "live"):
        (shown / name).mkdir(parents=True)
        (shown / name / "text").write_text(name)
    look = "cat /kit/x/*/text; (: >/kit/x/mine); (: >/kit/x/a/mine); echo done >&3; read wait <&3"
    parts = {shown / "a": "/kit/x/a", shown / "b": "/kit/x/b"}
    for more, expected, count in (({}, b"ab", 1), ({shown / "live": "/kit/x/live"}, b"ablive", 3)):
        live = frozenset(more.values())
        command = ("/bin/sh", "-c", look)
        with open_box(BoxSpec(command, parts | more, slot=SLOT, copies=place, limits=SMALL, live=live)) as box:
            box.ready(PATIENCE_S)
            mounts = Path(f"/proc/{find_program(box.pid)}/mountinfo").read_text()
            box.close()
        log = box.log()
        assert log.startswith(expected) and log.count(b"Read-only file system") == 2, log
        assert mounts.count(" /kit") == count
        inodes = {path.stat().st_ino for name in ("a", "b") for path in (shown / name).iterdir()}
        assert inodes.isdisjoint(path.stat().st_ino for path in place.rglob("text"))
    remove_idle_files(place)


@pytest.mark.parametrize("is_finished", [True, False])
def test_a_half_removed_copy_is_never_used(is_finished: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is killed while it removes copies leaves no copy under its name."""
    place, kill = reachable(tmp_path) / "copies", KeyboardInterrupt
    place.mkdir()
    spec = BoxSpec(("/bin/sh", "-c", "echo whole"), {}, slot=SLOT, copies=place, limits=SMALL)

    def remove_one_file(path: Path) -> None:
        next(each for each in path.rglob("*") if each.is_symlink() or each.is_file()).unlink()
        raise kill

    with open_box(spec) as box:
        box.ready(PATIENCE_S)
    with monkeypatch.context() as killed, pytest.raises(kill):
        killed.setattr(shutil, "rmtree", remove_one_file)
        remove_idle_files(place)
    names = [path.name for path in place.glob("*/*/*")]
    assert len(names) == 1 and names[0].startswith(".old-system-")
    if is_finished:
        with open_box(spec) as box:
            box.ready(PATIENCE_S)
        assert box.log() == b"whole\n"
    remove_idle_files(place)
    assert not list(place.glob("*/*"))


def test_no_room_for_the_copies_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=0))
    with pytest.raises(InputError, match=r"sandbox: expected \d+ MiB free in .* found 0 MiB; make it larger"):
        open_box(BoxSpec(("/bin/true",), {}, slot=SLOT, copies=tmp_path))
    with pytest.raises(InputError, match="absent, for the files of boxes"):
        open_box(BoxSpec(("/bin/true",), {}, slot=SLOT, copies=Path("/proc/absent")))


def test_what_a_box_is_told_of_the_host_stays_files_that_it_may_read(tmp_path: Path) -> None:
    """Permissions are copied, links too, hidden folders are left out, what the caller writes meanwhile is seen."""
    shown = reachable(tmp_path) / "shown"
    (shown / "secret").mkdir(parents=True)
    (shown / "secret" / "route").write_text("A to B")
    (shown / "closed").write_text("closed")
    (shown / "closed").chmod(0o600)
    (shown / "link").symlink_to("open")
    (shown / "open").write_text("open ")
    frames = tmp_path / "frames"
    frames.mkdir()
    text = "cat /shown/link /shown/closed; ls /shown/secret; read line <&3; cat /frames/now"
    spec = BoxSpec(
        ("/bin/sh", "-c", text),
        {shown: "/shown", frames: "/frames"},
        slot=SLOT,
        copies=MEMORY,
        live=frozenset({"/frames"}),
        hidden=(shown / "secret",),
    )
    with open_box(spec) as box:
        (frames / "now").write_text("frame")
        (frames / "now").chmod(0o644)
        box.socket.sendall(b"go\n")
        box.ready(PATIENCE_S)
        box.close()
    assert box.log() == b"open cat: /shown/closed: Permission denied\nframe"
    assert not list((MEMORY / "mdrive-sumo-files-0" / str(SLOT)).rglob("route"))
    remove_idle_files(MEMORY, (SLOT,))
