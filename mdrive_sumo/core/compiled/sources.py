"""What the compiled layer is built from. `hatch_build.py` runs this file alone: only the standard library is there."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

KINDS = (".c", ".h", ".f64")
"""C files, headers, and the tables that they embed."""


def list_sources(package: Path) -> list[str]:
    """Return the files of the package `mdrive_sumo` that the layer is built from, relative to it, in order."""
    files = [path.relative_to(package).as_posix() for path in package.rglob("*.*") if path.suffix in KINDS]
    return sorted(files)


def digest_sources(package: Path, names: Iterable[str]) -> str:
    """Return a digest of the names and contents of these files. Raises OSError."""
    digest = hashlib.blake2b(digest_size=16)
    for name in names:
        digest.update(f"{name}\0".encode() + (package / name).read_bytes() + b"\0")
    return digest.hexdigest()
