"""Checksums of files."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from mdrive_sumo.core.input_files import open_regular

PART_BYTES = 2**20
"""Read at once."""
MAX_CHECKED_BYTES = 2**32
"""Bytes of a file that has a checksum; weights and shards of training data are the largest."""

SHORT_CHECKSUM = 12
"""Hexadecimal digits of a checksum that tables show: two different ones agree in them once in 10^14 cases."""


def compute_files_checksum(files: Mapping[str, Path]) -> str:
    """Return the SHA-256 of names and contents of files in the order of their names, as "sha256:HEX"."""
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0")
        with open_regular(path, MAX_CHECKED_BYTES) as file:
            while part := file.read(PART_BYTES):
                digest.update(part)
    return "sha256:" + digest.hexdigest()


def compute_file_checksum(path: Path) -> str:
    """Return the SHA-256 of a file's content, whatever its name, as "sha256:HEX". Raises OSError."""
    with open_regular(path, MAX_CHECKED_BYTES) as file:
        return "sha256:" + hashlib.file_digest(file, "sha256").hexdigest()
