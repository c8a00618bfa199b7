"""The part of this host's programs that a box with files of its own gets: an interpreter and what it loads.

All of `/usr` is gigabytes; a copy for each box must be small.
"""

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.elf_libraries import find_libraries

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
    found = {Path("/usr/bin", name) for name in PROGRAMS}
    executable = Path(program)
    library = _find_python_library(executable.resolve()) if executable.is_file() else []
    compiled = [*found, executable, *(path for folder in library for path in folder.glob("lib-dynload/*.so"))]
    if executable.is_relative_to("/usr") and executable.is_file():
        found |= {executable, *library}
    found |= {Path(name) for name in FIXED}
    found |= find_libraries([path.resolve() for path in compiled], WHEEL_LIBRARIES)
    return tuple(sorted({path for start in found for path in _follow_links(start) if os.path.lexists(path)}))


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
