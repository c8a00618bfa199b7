"""What a box costs to start and to end: `python tests/bench/sandbox_start.py` prints milliseconds.

From the call of `open_box` to the first answer of a program that imports numpy, and the same without a box.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from testing.sandbox_runs import python_spec

from mdrive_sumo.agent_process.sandbox import BoxSpec, open_box

STARTS = 15
SLOT = 990


def specs(backend: str) -> dict[str, BoxSpec]:
    """A shell that answers at once, and a program that imports numpy first."""
    shell = BoxSpec(("/bin/sh", "-c", "echo answer >&3; read wait <&3"), {}, slot=SLOT, backend=backend)
    return {"shell": shell, "numpy": python_spec("good", slot=SLOT, backend=backend)}


def once(spec: BoxSpec) -> tuple[float, float]:
    """Time to the first answer and time to close [ms]."""
    began = time.perf_counter()
    box = open_box(spec)
    box.socket.sendall(np.ones(3).tobytes())
    if not box.ready(60.0) or not box.socket.recv(64):
        raise RuntimeError(box.log().decode(errors="replace"))
    answered = time.perf_counter()
    box.close()
    return (answered - began) * 1e3, (time.perf_counter() - answered) * 1e3


def main() -> None:
    """Backends in turn, so that other work on the machine strikes all alike."""
    rows = {(name, b): spec for b in sys.argv[1:] or ("none", "bubblewrap") for name, spec in specs(b).items()}
    found: dict[tuple[str, str], list[tuple[float, float]]] = {key: [] for key in rows}
    for _ in range(STARTS):
        for key, spec in rows.items():
            found[key].append(once(spec))
    for (name, backend), times in sorted(found.items()):
        starts, ends = zip(*times, strict=True)
        sys.stdout.write(
            f"{name:6} {backend:10}  first answer {statistics.median(starts):6.1f} ms (least {min(starts):.1f}), "
            f"close {statistics.median(ends):5.1f} ms (least {min(ends):.1f}), {STARTS} starts\n"
        )


if __name__ == "__main__":
    main()
