"""The part of this host's programs that a box with files of its own gets: an interpreter and what it loads.

All of `/usr` is gigabytes; a copy for each box must be small. Which shared libraries a program loads is read from its
ELF file; no loader is run. Source of the layout: elf(5).
"""

import os
import struct
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

PROGRAMS = ("sh", "env", "cat", "ls", "readlink", "true", "sleep", "id", "uname")
"""Of the host's commands: a shell and what scripts of a box use."""

WHEEL_LIBRARIES = (
    *("libc.so.6", "libm.so.6", "libdl.so.2", "librt.so.1", "libpthread.so.0", "libresolv.so.2", "libutil.so.1"),
    *("libgcc_s.so.1", "libstdc++.so.6", "libz.so.1", "libexpat.so.1", "libcrypt.so.1", "libgomp.so.1"),
)
"""What compiled packages may expect of a system: source PEP 600 (manylinux), without graphics, and OpenMP."""

FIXED = ("/etc/ld.so.cache", "/usr/lib/locale/C.utf8", "/usr/share/zoneinfo/UTC")

UNUSED = ("test", "idlelib", "turtledemo", "ensurepip", "site-packages", "dist-packages", "lib2to3")
"""Of a Python's library: what no agent runs. Packages come from the environment."""


def is_unused(relative: Path) -> bool:
    """Whether a path below an interpreter's prefix is left out of a copy."""
    top, *rest = relative.parts
    if top in ("include", "share") or relative.name.endswith((".opt-1.pyc", ".opt-2.pyc")):
        return True
    if top == "bin" and rest:
        return not rest[0].startswith("python")
    if top != "lib" or not rest:
        return False
    if len(rest) == 1:
        return rest[0].endswith(".a") or rest[0] == "pkgconfig"
    return rest[0].startswith("python3") and (rest[1] in UNUSED or rest[1].startswith("config-"))


def is_interpreter_prefix(folder: Path) -> bool:
    """Whether a folder holds the installation of a Python."""
    return any(folder.glob("bin/python3*"))


@cache
def list_runtime_paths(program: str) -> tuple[Path, ...]:
    """Return the host's files and folders that `program` needs, as its box looks them up: absolute, links included."""
    paths = {Path("/usr/bin", name) for name in PROGRAMS}
    executable = Path(program)
    library = _find_python_library(executable.resolve()) if executable.is_file() else []
    compiled = [*paths, executable, *(path for folder in library for path in folder.glob("lib-dynload/*.so"))]
    if executable.is_relative_to("/usr") and executable.is_file():
        paths |= {executable, *library}
    paths |= {Path(name) for name in FIXED}
    paths |= find_libraries([path.resolve() for path in compiled], WHEEL_LIBRARIES)
    return tuple(sorted({path for start in paths for path in _follow_links(start) if os.path.lexists(path)}))


def _find_python_library(executable: Path) -> list[Path]:
    return [path for path in [executable.parents[1] / "lib" / executable.name] if path.is_dir()]


def _follow_links(path: Path) -> Iterator[Path]:
    """The path in its real folder, and the file that it is a link to, if it is one."""
    for _ in range(40):  # the kernel's own limit of links
        path = path.parent.resolve() / path.name
        yield path
        if not path.is_symlink():
            return
        path = path.parent / path.readlink()


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
    libraries: set[Path] = set()
    waiting = [*programs]
    wanted = [*names]
    while waiting or wanted:
        if waiting:
            wanted += read_needed(waiting.pop())
            continue
        name = wanted.pop()
        path = Path(name) if name.startswith("/") else _find_library(name)
        if path is not None and path.is_file() and path not in libraries:
            libraries.add(path)
            waiting.append(path)
    return frozenset(libraries)


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
