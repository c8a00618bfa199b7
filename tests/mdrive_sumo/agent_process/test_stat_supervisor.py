"""What a box is told by `fstat`: files as they are, no number of an anonymous object, an error where no one answers."""

import errno
import json
import os
import platform
import signal
import socket
import stat
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.sandbox_runs import PATIENCE_S, SMALL, find_supervisor, needs_bubblewrap, needs_root, own_slot

from mdrive_sumo.agent_process.sandbox import (
    Box,
    BoxError,
    BoxKilledError,
    BoxReport,
    BoxSpec,
    cgroups,
    command_lines,
    open_box,
    stat_supervisor,
    supervisor_process,
)
from mdrive_sumo.agent_process.sandbox.stat_supervisor import STAT, pack_stat

pytestmark = [
    needs_bubblewrap,
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() != "x86_64", reason="numbers of system calls are those of x86-64"),
    pytest.mark.skipif(not Path("/usr/bin/python3").exists(), reason="needs the system's Python"),
]

SLOT = own_slot()
SERVE = """
import ctypes, errno, json, os, socket, sys
libc = ctypes.CDLL(None, use_errno=True)
buffer = ctypes.create_string_buffer(144)

def call(number, *words):
    found = libc.syscall(ctypes.c_long(number), *(ctypes.c_long(w) if isinstance(w, int) else w for w in words))
    return 0 if found >= 0 else ctypes.get_errno()

def look(fd):
    try:
        return list(os.fstat(fd))[:7]
    except OSError as error:
        return errno.errorcode[error.errno]

with socket.socket(fileno=3) as evaluator, evaluator.makefile("rw") as lines:
    for line in lines:
        try:
            answer = eval(line)
        except OSError as error:
            answer = errno.errorcode[error.errno]
        lines.write(json.dumps(answer) + chr(10))
        lines.flush()
"""


class AskedProgram:
    """A program in a box that evaluates expressions."""

    def __init__(self, box: Box) -> None:
        self.box = box
        box.socket.settimeout(PATIENCE_S)
        self._lines = box.socket.makefile("rw")

    def ask(self, expression: str) -> object:
        self._lines.write(expression + "\n")
        self._lines.flush()
        return json.loads(self._lines.readline())


@pytest.fixture
def caller() -> Iterator[AskedProgram]:
    with open_box(SPEC) as box:
        yield AskedProgram(box)


def test_files_are_told_as_they_are(caller: AskedProgram) -> None:
    """Programs compare what a path and a descriptor tell, `shutil.rmtree` for one."""
    for path in ("/usr/bin/python3", "/usr", "/tmp", "/dev/zero", "/proc/version"):
        assert caller.ask(f"list(os.fstat(os.open('{path}', 0))) == list(os.stat('{path}'))") is True, path
    assert caller.ask("os.stat(os.open('/tmp', 0))[1] > 0") is True
    assert caller.ask("call(262, -100, b'', buffer, 0x1000) == 0 and buffer.raw[8:16] != bytes(8)") is True


def test_an_object_without_a_name_has_a_kind_and_a_size_but_no_number(caller: AskedProgram) -> None:
    makers = {
        "os.pipe()[0]": stat.S_IFIFO,
        "socket.socketpair()[0].detach()": stat.S_IFSOCK,
        "os.memfd_create('x')": stat.S_IFREG,
        "os.eventfd(0)" if hasattr(os, "eventfd") else "os.pipe()[1]": None,
        "3": stat.S_IFSOCK,
        "1": stat.S_IFIFO,
        "0": stat.S_IFCHR,
    }
    for maker, kind in makers.items():
        mode, *identity = caller.ask(
            f"(lambda fd: [os.fstat(fd)[0], *list(os.fstat(fd))[1:3], *os.fstat(fd)[7:]])({maker})"
        )  # type: ignore[misc]
        assert identity == [0] * 5, maker
        assert kind is None or stat.S_IFMT(mode) == kind, maker
    assert caller.ask("(lambda fd: [os.truncate(fd, 77), os.fstat(fd).st_size])(os.memfd_create('x'))") == [None, 77]


BAD = (
    ("call(5, 77, buffer)", errno.EBADF),
    ("call(5, -1, buffer)", errno.EBADF),
    ("call(5, -100, buffer)", errno.EBADF),
    ("call(5, 3, 1)", errno.EFAULT),
    ("call(5, 3, 0)", errno.EFAULT),
    ("call(5, 3, -1)", errno.EFAULT),
    ("call(262, 3, b'', buffer, 0x1000 | 0x80)", errno.EINVAL),
    ("call(262, 3, b'x', buffer, 0x1000)", errno.EINVAL),
    ("call(262, 3, 1, buffer, 0x1000)", errno.EFAULT),
    ("call(262, 3, None, buffer, 0x1000)", 0),
    ("call(5, 3 | 1 << 40, buffer)", 0),
)


@pytest.fixture(scope="module")
def lasting_caller() -> Iterator[AskedProgram]:
    with open_box(BoxSpec(("/usr/bin/python3", "-c", SERVE), {}, slot=SLOT + 1, limits=SMALL)) as box:
        yield AskedProgram(box)


@pytest.mark.parametrize(("expression", "expected"), BAD)
def test_a_bad_call_gets_the_error_of_the_kernel(lasting_caller: AskedProgram, expression: str, expected: int) -> None:
    assert lasting_caller.ask(expression) == expected


def test_a_program_that_lets_nobody_look_into_it_gets_an_error(caller: AskedProgram) -> None:
    assert caller.ask("call(157, 4, 0, 0, 0, 0)") == 0  # PR_SET_DUMPABLE
    assert caller.ask("look(3)") == "EACCES"


SPEC = BoxSpec(("/usr/bin/python3", "-c", SERVE), {}, slot=SLOT, limits=SMALL)


def wait_until_unanswered(caller: AskedProgram) -> None:
    end = time.monotonic() + PATIENCE_S
    while caller.ask("look(3)") != "ENOSYS" and time.monotonic() < end:
        time.sleep(0.01)
    assert caller.ask("look(os.pipe()[0])") == "ENOSYS"  # an error and no number


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_supervisor_is_ours_once(number: int) -> None:
    """Also where the program goes on without: it was told errors. The second time it is the program's failure."""
    needs_root()
    caller = AskedProgram(open_box(SPEC))
    assert isinstance(caller.ask("look(3)"), list)
    os.kill(find_supervisor(caller.box), number)
    wait_until_unanswered(caller)
    with pytest.raises(BoxKilledError, match="the supervisor of the box was ended by a signal, which may have come"):
        caller.box.close()
    with open_box(replace(SPEC, owns_signals=True)) as box:
        caller = AskedProgram(box)
        caller.ask("look(3)")
        os.kill(find_supervisor(box), number)
        wait_until_unanswered(caller)
        assert box.close().signal == signal.SIGKILL


def test_a_supervisor_that_is_killed_before_the_box_begins_is_ours_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def request_killed(*_: object) -> socket.socket:
        ours, theirs = socket.socketpair()
        theirs.close()
        return ours

    monkeypatch.setattr(command_lines, "request_supervisor", request_killed)
    with pytest.raises(BoxKilledError, match="supervisor"):
        close_ended(open_box(SPEC))
    with pytest.raises(BoxError, match="bubblewrap failed") as caught:
        close_ended(open_box(replace(SPEC, owns_signals=True)))
    assert not isinstance(caught.value, BoxKilledError)


def close_ended(box: Box) -> BoxReport:
    """Close a box that has ended by itself, and whose supervisor has had time to notice."""
    while box.alive():
        time.sleep(0.01)
    time.sleep(0.2)
    return box.close()


@pytest.mark.parametrize(("end", "code"), [("os._exit(3)", 3), ("os.abort()", None)])
def test_a_program_that_ends_lets_its_supervisor_end(end: str, code: int | None) -> None:
    """The supervisor has ended then, too, and that is nobody's kill."""
    with open_box(SPEC) as box:
        caller = AskedProgram(box)
        caller.ask("look(3)")
        with pytest.raises((ConnectionError, json.JSONDecodeError)):
            caller.ask(end)
        assert close_ended(box).exit_code == code


def test_the_death_of_all_supervisors_ends_those_of_boxes_and_the_next_box_has_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    needs_root()
    own: dict[int, socket.socket] = {}
    monkeypatch.setattr(supervisor_process, "_CONTROLS", own)  # not those of other tests
    caller = AskedProgram(open_box(SPEC))
    caller.ask("look(3)")
    parent = int(Path(f"/proc/{find_supervisor(caller.box)}/stat").read_text().rpartition(")")[2].split()[1])
    assert Path(f"/proc/{parent}/cmdline").read_text().split("\0")[-2] == stat_supervisor.__file__
    os.kill(parent, signal.SIGKILL)
    wait_until_unanswered(caller)
    with pytest.raises(BoxKilledError, match="supervisor"):
        caller.box.close()
    with open_box(SPEC) as box:
        assert isinstance(AskedProgram(box).ask("look(3)"), list)
    own.popitem()[1].close()


def test_the_work_of_a_supervisor_counts_as_the_boxs(caller: AskedProgram) -> None:
    hierarchy = cgroups.find_hierarchy()
    if hierarchy is None:
        pytest.skip("needs control groups")
    caller.ask("look(3)")
    for folder in set(hierarchy.folders.values()):
        members = (folder / f"mdrive-box-{caller.box.slot}" / "cgroup.procs").read_text().split()
        assert str(find_supervisor(caller.box)) in members


def test_calls_of_many_threads_and_signals_are_all_answered(caller: AskedProgram) -> None:
    """Signals restart calls here: a call that waits for its turn may else end with EINTR, as docs/sandbox.md says."""
    text = (
        "[__import__('signal').signal(14, lambda *_: None), __import__('signal').siginterrupt(14, False),"
        " __import__('signal').setitimer(0, 1e-3, 1e-3),"
        " sum(__import__('concurrent.futures').futures.ThreadPoolExecutor(8).map("
        "lambda _: sum(call(5, 3, ctypes.create_string_buffer(144)) for _ in range(50)), range(8)))][3]"
    )
    assert caller.ask(text) == 0


NUMBER = st.integers(0, 2**31 - 1)


@given(st.tuples(*[NUMBER] * 16), st.integers(0, 2**16 - 1), st.booleans())
def test_only_a_known_object_has_numbers_and_times(numbers: tuple[int, ...], mode: int, known: bool) -> None:
    inode, size, blocks, block, links, uid, gid, *rest = numbers
    times = [(second, 5, 0) for second in rest[:4]]
    node_major, node_minor, major, minor, mount = (each % 4096 for each in rest[4:])
    found = (0x17FF, block, 0, links, uid, gid, mode, inode, size, blocks, 0, *(x for time in times for x in time))
    packed = pack_stat((*found, node_major, node_minor, major, minor, mount), known, uid)
    result = STAT["x86_64"].unpack(packed)
    assert result[3] == mode and result[7] == size
    assert (result[0], result[1]) == ((os.makedev(major, minor), inode) if known else (0, 0))
    assert result[10:] == ((times[0][0], 5, times[3][0], 5, times[2][0], 5) if known else (0,) * 6)
    assert result[4:6] == (uid, gid if gid == uid else stat_supervisor.OVERFLOW_ID)
