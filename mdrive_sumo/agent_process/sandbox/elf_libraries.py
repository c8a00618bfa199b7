"""The shared libraries that programs of this host load: ELF files read directly, no loader is run.

Source of the layout: elf(5).
"""

import struct
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

LIBRARY_FOLDERS = ("/lib", "/usr/lib", "/usr/local/lib", "/lib64", "/usr/lib64")
"""Each also with one level of folders below it, such as `x86_64-linux-gnu`."""
HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
SEGMENT = struct.Struct("<IIQQQQQQ")
ENTRY = struct.Struct("<qQ")
LOADED, DYNAMIC, LOADER = 1, 2, 3
"""PT_LOAD, PT_DYNAMIC, PT_INTERP."""
NEEDED, STRINGS = 1, 5
"""DT_NEEDED, DT_STRTAB."""
MAGIC = b"\x7fELF\x02\x01"
"""64 bits, little-endian: the only kind that boxes run."""


def find_libraries(programs: Iterable[Path], names: Iterable[str] = ()) -> frozenset[Path]:
    """Return the paths, as the loader looks them up, of all libraries that these programs need, and of `names`."""
    found: set[Path] = set()
    waiting = [*programs]
    wanted = [*names]
    while waiting or wanted:
        if waiting:
            wanted += read_needed(waiting.pop())
            continue
        name = wanted.pop()
        path = Path(name) if name.startswith("/") else _find_library(name)
        if path is not None and path.is_file() and path not in found:
            found.add(path)
            waiting.append(path)
    return frozenset(found)


def read_needed(path: Path) -> tuple[str, ...]:
    """Return the names of the libraries and the path of the loader that an ELF file needs; () for other files."""
    try:
        data = path.read_bytes()
        return tuple(_read_needed(data)) if data.startswith(MAGIC) else ()
    except (OSError, struct.error):
        return ()


def _read_needed(data: bytes) -> Iterator[str]:
    header = HEADER.unpack_from(data)
    first, size, count = header[5], header[9], header[10]
    segments = [SEGMENT.unpack_from(data, first + i * size) for i in range(count)]
    loaded = [(address, length, offset) for kind, _, offset, address, _, length, _, _ in segments if kind == LOADED]
    for kind, _, offset, _, _, length, _, _ in segments:
        if kind == LOADER:
            yield _read_text(data, offset)
        if kind == DYNAMIC:
            rows = [ENTRY.unpack_from(data, place) for place in range(offset, offset + length, ENTRY.size)]
            table = next((value for tag, value in rows if tag == STRINGS), 0)
            start = next((table - a + o for a, n, o in loaded if a <= table < a + n), table)
            yield from (_read_text(data, start + value) for tag, value in rows if tag == NEEDED)


def _read_text(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode(errors="replace")


def _find_library(name: str) -> Path | None:
    return next((folder / name for folder in _list_library_folders() if (folder / name).is_file()), None)


@cache
def _list_library_folders() -> tuple[Path, ...]:
    roots = [Path(name) for name in LIBRARY_FOLDERS if Path(name).is_dir()]
    return (*roots, *(folder for root in roots for folder in sorted(root.glob("*-linux-gnu*")) if folder.is_dir()))
