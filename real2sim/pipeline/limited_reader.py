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
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import import_posix
from real2sim.hd_map import HdMap
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.pipeline.recording_transfer import TransferError, decode_value, encode_value
from real2sim.recording import Recording

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")


ANSWER_BYTES = 4 * 2**30
"""Largest answer: twice the arrays of `input_checks.MAX_ROWS`."""
READ, REFUSED, FAILED, NO_MEMORY = b"R", b"E", b"F", b"M"
"""First byte of an answer: a value, an InputError, another exception, out of memory."""
NO_ROOM = 100
"""Exit code of an answer that cannot be written, plus the error number (below 150)."""
MEMORY_BYTES = 6 * 2**30
"""Address space. pyarrow reserves 1.6 GB of it; arrays of `input_checks.MAX_ROWS` take 2 GB, and again as bytes."""
CPU_S = 300
"""[s] Processor time; the logs at hand take up to 2 s."""
LIMIT_S = 600.0
"""[s] Wall-clock limit: twice the processor time, for machines that do other work."""
PROGRAM = f"import gc; gc.disable(); from {__name__} import main; main()"
"""Of the process. It ends before garbage matters: looking for that would take a tenth of its time."""
T = TypeVar("T")


@dataclass(frozen=True)
class AnnotatedMap:
    """A vector map with the notes of its reader."""

    map: HdMap
    notes: tuple[str, ...]


def main() -> None:
    """Read what standard input orders and answer on what was standard output."""
    order = json.load(sys.stdin)
    _set_limits(order["memory_bytes"], order["cpu_s"])
    out = os.dup(1)
    os.dup2(2, 1)  # libraries print warnings
    answer = _answer(order)
    try:
        with os.fdopen(out, "wb") as file:
            file.write(answer)
    except OSError as error:
        sys.exit(NO_ROOM + (error.errno or 0))


def _set_limits(memory_bytes: int, cpu_s: int) -> None:
    for kind, limit in (
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_CPU, cpu_s + 1),
        (resource.RLIMIT_FSIZE, ANSWER_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (least, least))
    spare = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (max(spare - 1, 1), spare))  # SIGXCPU, which names the reason, then SIGKILL


def _answer(order: dict[str, Any]) -> bytes:
    try:
        return READ + encode_value(_read(order))
    except InputError as error:
        return REFUSED + str(error).encode()
    except MemoryError:
        return NO_MEMORY
    except Exception as error:  # noqa: BLE001 - the border where any failure on a stranger's file becomes a sentence
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = " ".join(str(error).split())[:300]
        return FAILED + f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {text}".encode()


def _read(order: dict[str, Any]) -> object:
    path = Path(order["path"])
    if order["source"] == "vector map":
        from real2sim.readers.v2xpnp_map import read_vector_map

        return AnnotatedMap(*read_vector_map(path))
    agents = order["agents"]
    return read_log(
        LogSource(
            order["source"],
            path,
            tuple(map(Path, order["maps"])),
            None if agents is None else tuple(agents),
            case=order["case"],
        )
    )


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
    command = (sys.executable, "-P", "-c", PROGRAM)
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
