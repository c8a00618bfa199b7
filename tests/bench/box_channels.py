"""What two boxes can still tell each other: `python tests/bench/box_channels.py` prints bits per second.

Both have files of their own (`copies`). In every time slot the sender does something or does nothing; the receiver
measures. Half of the slots, whose bits are known to the reader, set the threshold; the others give the error
rate e, and the capacity is (1 - H(e)) bits a slot. Other work on the machine lowers all figures.
"""

import json
import math
import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.sandbox_runs import reachable

from mdrive_sumo.agent_process.sandbox import BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY, remove_idle_files

SLOTS = (980, 981)
BITS = 200
START_S = 6.0
"""For both boxes to begin, with the copying of their files."""
PROGRAM = """
import json, os, sys, time
channel, role, start, slot_s, bits = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), sys.argv[5]
block = bytearray(32 << 20)

def work(until):
    count = 0
    if channel == "processor":
        while time.monotonic() < until:
            count += 1
    elif channel == "memory":
        while time.monotonic() < until:
            block[: 16 << 20] = block[16 << 20 :]
            count += 1
    elif channel == "inode numbers":
        if role == "send":
            while time.monotonic() < until:
                os.close(os.memfd_create("x"))
        else:
            first = 0
            for _ in range(1100):
                found = os.memfd_create("x")
                count = os.fstat(found).st_ino
                os.close(found)
    return count

seen = []
for i, bit in enumerate(bits):
    begin = start + i * slot_s
    time.sleep(max(0.0, begin - time.monotonic()))
    if role == "send":
        if bit == "1":
            work(begin + 0.8 * slot_s)
    elif channel == "inode numbers":
        time.sleep(max(0.0, begin + 0.5 * slot_s - time.monotonic()))
        seen.append(work(0.0))
    else:
        seen.append(work(begin + 0.8 * slot_s))
if channel == "inode numbers" and role == "read":
    seen = [b - a for a, b in zip([seen[0], *seen], seen)]
os.write(3, json.dumps(seen).encode() + b"\\n")
"""
CHANNELS = {"processor": (0.05, 0.02), "memory": (0.1, 0.05), "inode numbers": (0.02, 0.01)}
"""Lengths of a slot that are tried [s]."""


def transmit(folder: Path, channel: str, slot_s: float, bits: str) -> list[float]:
    """What the receiver measured in each slot."""
    start = time.monotonic() + START_S
    boxes = [
        open_box(
            BoxSpec(
                ("/usr/bin/python3", "/agent/program.py", channel, role, str(start), str(slot_s), bits),
                {folder: "/agent"},
                slot=slot,
                copies=MEMORY,
            )
        )
        for role, slot in zip(("send", "read"), SLOTS, strict=True)
    ]
    text = b""
    while not text.endswith(b"\n"):
        if not boxes[1].ready(60.0) or not (part := boxes[1].socket.recv(65536)):
            raise RuntimeError(boxes[1].log().decode())
        text += part
    for box in boxes:
        box.close()
    found: list[float] = json.loads(text)
    return found


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


def main() -> None:
    """Prints a row for each channel and length of a slot."""
    draw = random.Random(1)
    bits = "".join(draw.choice("01") for _ in range(BITS))
    with tempfile.TemporaryDirectory() as made:
        folder = reachable(Path(made))
        (folder / "program.py").write_text(PROGRAM)
        for channel, lengths in CHANNELS.items():
            for slot_s in lengths:
                error = find_error_rate(bits, transmit(folder, channel, slot_s, bits))
                rate = compute_capacity(error) / slot_s
                sys.stdout.write(f"{channel:14} slot {1e3 * slot_s:5.0f} ms  error {error:.2f}  {rate:6.1f} bit/s\n")
                sys.stdout.flush()
    remove_idle_files(MEMORY, SLOTS)


if __name__ == "__main__":
    main()
