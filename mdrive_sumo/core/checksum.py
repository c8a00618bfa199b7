"""Checksums of files."""

import hashlib
from collections.abc import Mapping
from pathlib import Path


def compute_files_checksum(files: Mapping[str, Path]) -> str:
    """Return the SHA-256 of names and contents of files in the order of their names, as "sha256:HEX"."""
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        digest.update(name.encode() + b"\0" + path.read_bytes())
    return "sha256:" + digest.hexdigest()


def compute_file_checksum(path: Path) -> str:
    """Return the SHA-256 of a file's content, whatever its name, as "sha256:HEX". Raises OSError."""
    return "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()
