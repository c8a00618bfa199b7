"""Archives of participants: checked as a whole before anything is unpacked into a new folder."""

from server.archive.extraction import extract_archive
from server.archive.layout import ArchiveLimits, ArchiveRefused
from server.archive.manifest import Manifest, check_archive, inspect_archive, verify_contents

__all__ = [
    "ArchiveLimits",
    "ArchiveRefused",
    "Manifest",
    "check_archive",
    "extract_archive",
    "inspect_archive",
    "verify_contents",
]
