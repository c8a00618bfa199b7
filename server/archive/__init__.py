"""Archives that participants send: checked whole before anything is unpacked, and unpacked into a fresh folder."""

from server.archive.errors import ArchiveRefused
from server.archive.extraction import extract_archive
from server.archive.limits import ArchiveLimits
from server.archive.manifest import Manifest, check_archive

__all__ = ["ArchiveLimits", "ArchiveRefused", "Manifest", "check_archive", "extract_archive"]
