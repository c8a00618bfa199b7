"""Read logs and maps of strangers in a process of their own, with limits of memory and time.

Parsers of binary formats crash on damaged files: pyarrow aborts, a pickle asks for 64 GiB with five bytes. Such a file
costs one sentence. The process has the user's permissions: it protects from crashes and floods, not from code.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from mdrive_sumo.core.errors import InputError
from real2sim.hd_map import HdMap
from real2sim.pipeline import reader_process
from real2sim.pipeline.log_source import LogSource
from real2sim.pipeline.reader_process import FAILED, NO_MEMORY, NO_ROOM, READ, REFUSED, AnnotatedMap
from real2sim.pipeline.recording_transfer import TransferError, decode_value
from real2sim.recording import Recording

MEMORY_BYTES = 6 * 2**30
"""Address space. pyarrow reserves 1.6 GB of it; arrays of `checked_arrays.MAX_ROWS` take 2 GB, and again as bytes."""
CPU_S = 300
"""[s] Processor time; the logs at hand take up to 2 s."""
LIMIT_S = 600.0
"""[s] Wall-clock limit: twice the processor time, for machines that do other work."""
T = TypeVar("T")


def read_log_limited(log: LogSource) -> Recording:
    """Read the whole log like `read_log`; raises InputError also if that crashes or exceeds a limit."""
    order = {
        "source": log.source,
        "path": str(log.path),
        "maps": [str(path) for path in log.maps],
        "agents": log.agents,
        "case": log.case,
    }
    return _run(order, log.path, Recording)


def read_vector_map_limited(path: Path) -> HdMap:
    """Read a vector map like `read_vector_map`; raises InputError also if that crashes or exceeds a limit."""
    return _run({"source": "vector map", "path": str(path)}, path, AnnotatedMap).map


def _run(order: Mapping[str, object], path: Path, expected: type[T]) -> T:
    order = {**order, "memory_bytes": MEMORY_BYTES, "cpu_s": CPU_S}
    command = (sys.executable, "-P", "-m", reader_process.__name__)
    with tempfile.TemporaryFile() as answer:
        try:
            done = subprocess.run(
                command,
                input=json.dumps(order).encode(),
                stdout=answer,
                stderr=subprocess.DEVNULL,
                env=_build_environment(),
                timeout=LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"{path}: expected a file that is read within {LIMIT_S:g} s, found no end") from None
        answer.seek(0)
        return _take_answer(done.returncode, answer.read(1), answer.read(), path, expected)


def _build_environment() -> Mapping[str, str]:
    """Return an environment in which the process finds the same modules, as workers of multiprocessing do."""
    return os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def _take_answer(exit_code: int, kind: bytes, data: bytes, path: Path, expected: type[T]) -> T:
    """Return the value of an answer; raise InputError."""
    if kind == REFUSED and exit_code == 0:
        raise InputError(" ".join(data.decode(errors="replace").split("\n")))
    if kind == READ and exit_code == 0:
        try:
            return decode_value(data, expected)
        except TransferError as error:
            raise InputError(f"{path}: expected an answer of its reader, found: {error}") from None
    if kind == FAILED and exit_code == 0:
        raise InputError(f"{path}: expected a valid file, its reader failed: {data.decode(errors='replace')}")
    raise InputError(f"{path}: {_describe_exit(exit_code, kind)}")


def _describe_exit(exit_code: int, kind: bytes) -> str:
    """Describe a reader that gave no answer."""
    gib = MEMORY_BYTES // 2**30
    if kind == NO_MEMORY:
        return f"expected a file that is read within {gib} GiB of memory, found one that needs more"
    if exit_code == -signal.SIGXCPU:
        return f"expected a file that is read within {CPU_S} s of processor time, found one that needs more"
    if exit_code < 0:
        name = signal.Signals(-exit_code).name
        return f"expected a complete file, found one that crashes its reader ({name}) or needs over {gib} GiB of memory"
    if exit_code > NO_ROOM:
        return f"expected room for a temporary file of its reader, found: {os.strerror(exit_code - NO_ROOM)}"
    return f"expected an answer of its reader, found none and the exit code {exit_code}"
