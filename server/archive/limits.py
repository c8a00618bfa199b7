"""How large an archive may be."""

from dataclasses import dataclass

MEBIBYTE = 1024 * 1024


@dataclass(frozen=True, slots=True)
class ArchiveLimits:
    """Ceilings; the names are those of `server.settings.Limits`."""

    archive_bytes: int = 64 * MEBIBYTE
    """Of the file as it is sent."""
    unpacked_bytes: int = 256 * MEBIBYTE
    """Of all files together."""
    entries: int = 2000
    """Files and folders, also folders that are only part of a path."""
    ratio: int = 200
    """Unpacked over packed, of each entry above 1 MiB."""
