"""What the compiled layer is built from. `hatch_build.py` runs this file alone: only the standard library is there."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

KINDS = (".c", ".h", ".f64")
"""C files, headers, and the tables that they embed."""
PACKAGES = ("mdrive_sumo", "real2sim")
"""Packages that have such files."""


def list_sources(root: Path) -> list[str]:
    """Return the files that the layer is built from, relative to the folder of the packages, in order."""
    paths = [path for package in PACKAGES for path in (root / package).rglob("*.*") if path.suffix in KINDS]
    return sorted(path.relative_to(root).as_posix() for path in paths)


def digest_sources(root: Path, names: Iterable[str]) -> str:
    """Return a digest of the names and contents of these files. Raises OSError."""
    digest = hashlib.blake2b(digest_size=16)
    for name in names:
        digest.update(f"{name}\0".encode() + (root / name).read_bytes() + b"\0")
    return digest.hexdigest()
