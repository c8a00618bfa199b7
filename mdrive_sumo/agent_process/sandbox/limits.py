"""What a box may use, and the ceilings among it that the kernel keeps for each process."""

import os
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")

MEBIBYTE = 1024**2


@dataclass(frozen=True, slots=True)
class BoxLimits:
    """Ceilings of one box, that is of all processes in it together unless said otherwise."""

    memory_bytes: int = 512 * MEBIBYTE
    """Kept by a memory cgroup; without one it is RLIMIT_AS, that is address space *per process*."""
    processes: int = 64
    """Processes and threads."""
    cpu_s: int = 120
    """CPU time of each process [s]: the backstop behind the evaluator's deadlines."""
    file_bytes: int = 16 * MEBIBYTE
    """Largest single file, in the temporary folder or in shared memory."""
    tmp_bytes: int = 64 * MEBIBYTE
    """Size of `/tmp`, and again of `/dev/shm`; both count into the memory."""
    open_files: int = 128
    log_bytes: int = 64 * 1024
    """How much of the end of standard output and error is kept."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value: object = getattr(self, field.name)
            if type(value) is not int or value < 1:
                raise InputError(f"limits of the sandbox, {field.name}: expected a positive integer, found {value!r}")


CPU_GRACE_S = 1
"""Between SIGXCPU, which says what happened, and SIGKILL."""

DEAD = 4
"""Times as many processes where a control group counts them too: room for the dead of earlier boxes in the slot, which
count until the host's first process has collected them."""


def list_rlimits(limits: BoxLimits, own_uid: bool, grouped: bool) -> tuple[tuple[int, int, int], ...]:
    """Which limit, soft and hard value.

    `own_uid`: the box has a user of its own; otherwise the processes that its user already runs are counted in.
    `grouped`: a control group keeps the memory. RLIMIT_AS would only break programs that reserve more than they use.
    """
    others = 0 if own_uid else count_threads(os.getuid())
    processes, cpu = limits.processes * (DEAD if grouped else 1) + others, limits.cpu_s
    rows = [
        (resource.RLIMIT_NPROC, processes, processes),
        (resource.RLIMIT_CPU, cpu, cpu + CPU_GRACE_S),
        (resource.RLIMIT_FSIZE, limits.file_bytes, limits.file_bytes),
        (resource.RLIMIT_NOFILE, limits.open_files, limits.open_files),
        (resource.RLIMIT_CORE, 0, 0),
    ]
    if not grouped:
        rows.append((resource.RLIMIT_AS, limits.memory_bytes, limits.memory_bytes))
    return tuple((which, _cap(which, soft), _cap(which, hard)) for which, soft, hard in rows)


def _cap(which: int, value: int) -> int:
    """A plain user cannot raise a limit that is lower already."""
    hard = resource.getrlimit(which)[1]
    return value if hard == resource.RLIM_INFINITY or os.geteuid() == 0 else min(value, hard)


def count_threads(uid: int) -> int:
    """Processes and threads that a user runs now, as RLIMIT_NPROC counts them."""
    count = 0
    for status in Path("/proc").glob("[0-9]*/status"):
        with suppress(OSError):
            rows = dict(line.split(":\t", 1) for line in status.read_text().splitlines() if ":\t" in line)
            count += int(rows["Threads"]) if int(rows["Uid"].split()[0]) == uid else 0
    return count
