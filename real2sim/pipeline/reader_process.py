"""The process that reads a log or a map of strangers, with limits: `python -m real2sim.pipeline.reader_process`.

It gets the order on standard input as JSON and writes one answer: a letter, then a value (`recording_transfer`) or a
sentence. `limited_reader` starts it.
"""

import json
import os
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import import_posix
from real2sim.hd_map import HdMap
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.pipeline.recording_transfer import encode_value

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")

ANSWER_BYTES = 4 * 2**30
READ, REFUSED, FAILED, NO_MEMORY = b"R", b"E", b"F", b"M"
"""First byte of an answer: a value, an InputError, another exception, out of memory."""
NO_ROOM = 100
"""Exit code of an answer that cannot be written, plus the error number (below 150)."""


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


if __name__ == "__main__":
    main()
