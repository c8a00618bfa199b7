"""What two boxes can still tell each other: `python tests/bench/box_channels.py` prints bits per second and submission.

Both have files of their own (`copies`). First of boxes that live at the same time: in every time slot the sender does
something or does nothing, and the receiver measures. Half of the slots, whose bits are known to the reader, set the
threshold; the others give the error rate e, and the capacity is (1 - H(e)) bits a slot. The processes of both are bound
from outside to no processor, to the same one, or to one each. Then of boxes that follow each other: the first makes a
number of objects, the second looks at the number of a new one. Other work on the machine lowers all figures.
"""

import json
import math
import os
import random
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.sandbox_runs import processes_of, reachable

from mdrive_sumo.agent_process.sandbox import Box, BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY, remove_idle_files
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID

SLOTS = (980, 981)
BITS = 200
START_S = 3.0
"""For both boxes to begin; their files are copied before."""
PROGRAM = """
import json, os, sys, time
channel, role, start, slot_s, bits = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), sys.argv[5]
block = bytearray(32 << 20)

def make_pipe():
    ends = os.pipe()
    number = os.fstat(ends[0]).st_ino
    os.close(ends[0]); os.close(ends[1])
    return number

def make_memory_file():
    fd = os.memfd_create("x")
    number = os.fstat(fd).st_ino
    os.close(fd)
    return number

def create_pipe():
    for end in os.pipe():
        os.close(end)

def create_memory_file():
    os.close(os.memfd_create("x"))

make = {"inode of a pipe": make_pipe, "inode of a memory file": make_memory_file}.get(channel)
create = {"inode of a pipe": create_pipe, "inode of a memory file": create_memory_file}.get(channel)

def work(until):
    count = 0
    if channel == "processor":
        while time.monotonic() < until:
            count += 1
    elif channel == "memory":
        while time.monotonic() < until:
            block[: 16 << 20] = block[16 << 20 :]
            count += 1
    elif channel == "fstat":
        while time.monotonic() < until:
            os.fstat(3)
            count += 1
    elif channel == "page faults":
        import mmap
        while time.monotonic() < until:
            mmap.mmap(-1, 4096)[:1]
            count += 1
    elif channel == "present processor":
        import ctypes
        processor = ctypes.CDLL(None).sched_getcpu
        while time.monotonic() < until:
            count += processor()
            if role == "read":
                time.sleep(5e-4)
    elif role == "send":
        while time.monotonic() < until:
            create()
    return count

if start == 0:  # boxes that follow each other
    if role == "send":
        for _ in range(int(bits)):
            create()
    os.write(3, json.dumps([make()]).encode() + b"\\n")
    sys.exit()
seen = []
for i, bit in enumerate(bits):
    begin = start + i * slot_s
    time.sleep(max(0.0, begin - time.monotonic()))
    if role == "send":
        if bit == "1":
            work(begin + 0.8 * slot_s)
    elif make:
        time.sleep(max(0.0, begin + 0.85 * slot_s - time.monotonic()))
        seen.append(make())
    else:
        seen.append(work(begin + 0.8 * slot_s))
if make and role == "read":
    seen = [b - a for a, b in zip([seen[0], *seen], seen)]
os.write(3, json.dumps(seen).encode() + b"\\n")
"""
CHANNELS = {
    "processor": (0.05, 0.02),
    "memory": (0.1, 0.05),
    "fstat": (0.05, 0.02),
    "page faults": (0.05, 0.02),
    "present processor": (0.05, 0.02),
    "inode of a pipe": (0.02, 0.005),
    "inode of a memory file": (0.02, 0.005),
}
"""Lengths of a slot that are tried [s]."""
PROCESSORS = sorted(os.sched_getaffinity(0))
PLACES = {"any": None, "the same": (PROCESSORS[0], PROCESSORS[0]), "one each": (PROCESSORS[0], PROCESSORS[-1])}
"""Processors of sender and receiver."""
FOLLOWING = ("inode of a pipe", "inode of a memory file")
VALUES, STEP, TRIES = 256, 1024, 10
"""Of boxes that follow each other: a symbol is one of so many values, each so many objects more than the start of two
boxes makes by itself."""


def put_on(box: Box, processor: int | None) -> None:
    """Bind all processes of a box to a processor."""
    if processor is not None:
        for pid in processes_of(FIRST_UID + box.slot):
            with suppress(ProcessLookupError):
                os.sched_setaffinity(pid, {processor})


def open_program(folder: Path, slot: int, *arguments: str) -> Box:
    """Return a box in which the program above runs."""
    return open_box(
        BoxSpec(("/usr/bin/python3", "/agent/program.py", *arguments), {folder: "/agent"}, slot=slot, copies=MEMORY)
    )


def read_answer(box: Box) -> list[float]:
    """Return what the program measured."""
    text = b""
    while not text.endswith(b"\n"):
        if not box.ready(60.0) or not (part := box.socket.recv(65536)):
            raise RuntimeError(box.log().decode())
        text += part
    found: list[float] = json.loads(text)
    return found


def transmit(folder: Path, channel: str, slot_s: float, bits: str, place: tuple[int, int] | None) -> list[float]:
    """Return what the receiver measured in each slot."""
    start = time.monotonic() + START_S
    with ExitStack() as stack:
        boxes = [
            stack.enter_context(open_program(folder, slot, channel, role, str(start), str(slot_s), bits))
            for role, slot in zip(("send", "read"), SLOTS, strict=True)
        ]
        time.sleep(START_S / 2)
        for box, processor in zip(boxes, place or (None, None), strict=True):
            put_on(box, processor)
        return read_answer(boxes[1])


def find_error_rate(bits: str, seen: list[float]) -> float:
    """Threshold and direction of the first half, applied to the second."""
    half = len(bits) // 2
    means = [statistics.median(x for b, x in zip(bits[:half], seen[:half], strict=True) if b == bit) for bit in "01"]
    middle, rises = sum(means) / 2, means[1] > means[0]
    wrong = sum(((x > middle) == rises) != (b == "1") for b, x in zip(bits[half:], seen[half:], strict=True))
    return wrong / (len(bits) - half)


def compute_capacity(error: float) -> float:
    """Bits of a slot: of a binary symmetric channel."""
    e = min(error, 0.5)
    return 1.0 if e == 0 else 1 + e * math.log2(e) + (1 - e) * math.log2(1 - e)


def follow(folder: Path, channel: str) -> tuple[int, float]:
    """Return how many of the symbols arrive from boxes that have ended, and the time of one [s]."""
    draw, began, correct = random.Random(2), time.monotonic(), 0
    last = look(folder, channel)
    for _ in range(TRIES):
        value = draw.randrange(VALUES)
        with open_program(folder, SLOTS[0], channel, "send", "0", "0", str(value * STEP)) as box:
            put_on(box, PROCESSORS[0])
            read_answer(box)
        now = look(folder, channel)
        correct += int((now - last) / STEP) == value
        last = now
    return correct, (time.monotonic() - began) / TRIES


def look(folder: Path, channel: str) -> float:
    """Return the number that a new box is given."""
    with open_program(folder, SLOTS[1], channel, "read", "0", "0", "") as box:
        put_on(box, PROCESSORS[0])
        return read_answer(box)[0]


def main() -> None:
    """Prints a row for each channel, placement and length of a slot."""
    draw = random.Random(1)
    bits = "".join(draw.choice("01") for _ in range(BITS))
    wanted = sys.argv[1:] or [*CHANNELS]
    with tempfile.TemporaryDirectory() as made:
        folder = reachable(Path(made))
        (folder / "program.py").write_text(PROGRAM)
        for slot in SLOTS:
            open_program(folder, slot, FOLLOWING[0], "read", "0", "0", "").close()
        for channel in wanted:
            for placement, place in PLACES.items():
                for slot_s in CHANNELS[channel]:
                    error = find_error_rate(bits, transmit(folder, channel, slot_s, bits, place))
                    rate = compute_capacity(error) / slot_s
                    sys.stdout.write(
                        f"{channel:22} processors: {placement:8} slot {1e3 * slot_s:5.0f} ms  error {error:.2f}"
                        f"  {rate:6.1f} bit/s\n"
                    )
                    sys.stdout.flush()
        for channel in FOLLOWING:
            if channel in wanted:
                correct, each_s = follow(folder, channel)
                sys.stdout.write(
                    f"{channel:22} boxes that follow each other: {correct} of {TRIES} symbols of"
                    f" {math.log2(VALUES):.0f} bits, {each_s:.2f} s each\n"
                )
    remove_idle_files(MEMORY, SLOTS)


if __name__ == "__main__":
    main()
