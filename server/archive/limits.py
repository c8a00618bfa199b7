"""Size limits of an archive."""

from dataclasses import dataclass

MEBIBYTE = 1024 * 1024
FREE_BYTES = 8 * MEBIBYTE
"""Unpacked size up to which the ratio of a whole archive does not matter [bytes]."""


@dataclass(frozen=True, slots=True)
class ArchiveLimits:
    """Upper limits; the field names are those of `server.settings.ArchiveSettings`."""

    archive_bytes: int = 64 * MEBIBYTE
    """Size of the archive file."""
    unpacked_bytes: int = 256 * MEBIBYTE
    """Total size of all files."""
    entries: int = 2000
    """Number of files and folders, including folders that occur only as parts of paths."""
    ratio: int = 200
    """Unpacked size over packed size of each entry above 1 MiB."""
    total_ratio: int = 50
    """Total unpacked size over the size of the archive, above `FREE_BYTES`: bounds the work that an upload causes."""
