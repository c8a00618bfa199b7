"""Two boxes of gVisor have no number in common: what one's kernel counts, the other cannot read."""

import json
import shutil
import time
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import pytest
from testing.sandbox_runs import PATIENCE_S, needs_root, own_slot, python_spec, reachable

from mdrive_sumo.agent_process.sandbox import Box, BoxSpec, open_box

SLOT = own_slot()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("runsc") is None, reason="needs gVisor's runsc"),
]

COUNTERS = """
import json, os, select, socket, subprocess, tempfile
link = socket.socket(fileno=3)
lines = link.makefile("rw")

def take_numbers():
    "One of each object whose identity a kernel counts up, and the number that a program sees of it."
    found = {}
    def note(name, fd):
        found[name] = os.fstat(fd).st_ino
        os.close(fd)
    def try_note(name, make):
        try: note(name, make())
        except OSError as error: found[name] = -error.errno
    reading, writing = os.pipe()
    os.close(writing)
    note("pipe", reading)
    one, two = socket.socketpair()
    found["socket pair"] = os.fstat(one.fileno()).st_ino
    one.close(), two.close()
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found["socket"] = os.fstat(udp.fileno()).st_ino
    udp.close()
    try_note("memory file", lambda: os.memfd_create("x"))
    try_note("event file", lambda: os.eventfd(0))
    try_note("epoll", lambda: os.dup(select.epoll().fileno()))
    with tempfile.TemporaryFile() as file: found["file in /tmp"] = os.fstat(file.fileno()).st_ino
    with tempfile.TemporaryFile(dir="/dev/shm") as file: found["file in /dev/shm"] = os.fstat(file.fileno()).st_ino
    child = subprocess.Popen(["/bin/true"])
    child.wait()
    found["process"] = child.pid
    found["entry of /proc"] = os.stat(f"/proc/{os.getpid()}/status").st_ino
    return found

def burn():
    for _ in range(100):
        for fd in os.pipe(): os.close(fd)
        for end in socket.socketpair(): end.close()
        os.close(os.memfd_create("x")), os.close(os.eventfd(0))
        with tempfile.TemporaryFile(): pass
        os.stat("/proc/self/status")

for word in lines:
    if word == "burn\\n": burn()
    lines.write(json.dumps(take_numbers()) + "\\n")
    lines.flush()
"""


def counting_spec(slot: int) -> BoxSpec:
    spec = python_spec("selfexit", slot=slot, backend="gvisor")
    return BoxSpec((spec.command[0], "-c", COUNTERS), spec.readonly, slot=slot, backend="gvisor")


def ask(box: Box, word: str) -> dict[str, int]:
    box.socket.sendall(f"{word}\n".encode())
    text = b""
    while not text.endswith(b"\n"):
        assert box.ready(PATIENCE_S), box.log()
        piece = box.socket.recv(65536)
        assert piece, box.log()
        text += piece
    return json.loads(text)


def test_what_one_kernel_counts_moves_no_number_of_another() -> None:
    """The reader sees its own numbers go up by the same steps, whether its neighbour makes hundreds or none."""
    with ExitStack() as stack:
        reader, sender = (stack.enter_context(open_box(counting_spec(SLOT + i))) for i in range(2))
        numbers = [ask(reader, "look") for _ in range(3)]
        burnt = [ask(sender, "look"), ask(sender, "burn")]
        numbers.append(ask(reader, "look"))
    assert numbers[0].keys() >= {"pipe", "socket", "memory file", "process", "entry of /proc"}
    steps = [{name: after[name] - before[name] for name in after} for before, after in pairwise(numbers)]
    assert steps[2] == steps[1]
    counted = {name for name in burnt[0] if burnt[1][name] - burnt[0][name] > 99}
    assert {"pipe", "socket pair", "memory file"} <= counted, burnt


def test_two_kernels_begin_with_the_same_numbers() -> None:
    """Nothing of the host's counters is in them, so boxes one after the other see the same as well."""
    first: list[dict[str, int]] = []
    for _ in range(2):
        with open_box(counting_spec(SLOT)) as box:
            first.append(ask(box, "look"))
    assert first[0] == first[1]


STAT = """
import json, os, socket, sys
link = socket.socket(fileno=3)
paths = ["/data/read", "/data/unread", "/bin/true"]
def look():
    rows = [os.stat(path) for path in paths]
    return [[row.st_ino, row.st_dev, row.st_atime_ns, row.st_mtime_ns] for row in rows]
before = look()
if sys.argv[1] == "read":
    for path in (paths[0], paths[2]):
        with open(path, "rb") as file: file.read()
link.sendall(json.dumps([before, look()]).encode())
"""


def test_a_later_box_in_a_slot_sees_nothing_of_what_an_earlier_one_has_read(tmp_path: Path) -> None:
    """The file server opens the files for the box; times of access were those of the host."""
    needs_root()
    folder = reachable(tmp_path) / "data"
    folder.mkdir()
    for name in ("read", "unread"):
        (folder / name).write_text(name)
    base = python_spec("selfexit", slot=SLOT, readonly={folder: "/data"})
    seen: list[list[list[list[int]]]] = []
    for word in ("idle", "read", "idle"):
        command = (base.command[0], "-c", STAT, word)
        with open_box(BoxSpec(command, base.readonly, slot=SLOT, backend="gvisor")) as box:
            assert box.ready(PATIENCE_S), box.log()
            seen.append(json.loads(box.socket.recv(65536)))
        time.sleep(0.01)
    idle, reading, later = seen
    assert reading[0] == reading[1] == later[0] == idle[0]
    assert {row[0] for row in idle[0]}.isdisjoint({(folder / name).stat().st_ino for name in ("read", "unread")})
