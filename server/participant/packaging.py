"""A folder as an archive, and an archive as a folder."""

import tempfile
import zipfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from server.archive import ArchiveLimits, ArchiveRefused, Manifest, check_archive, extract_archive

SKIPPED = ("__pycache__", ".git", ".venv", ".DS_Store", ".ipynb_checkpoints", ".pytest_cache", "runs")
"""Files and folders that nobody means to send."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The oldest date that a zip file can hold: the same files make the same archive."""


@dataclass(frozen=True, slots=True)
class UnpackedAgent:
    """A checked archive, unpacked."""

    manifest: Manifest
    folder: Path


@contextmanager
def open_as_archive(path: Path, limits: ArchiveLimits) -> Generator[tuple[Path, Manifest]]:
    """A folder, packed, or an archive; checked as the server does it. Raises ArchiveRefused and InputError."""
    with tempfile.TemporaryDirectory(prefix="mdrive-team-") as scratch:
        archive = path
        if path.is_dir():
            archive = Path(scratch) / "team.zip"
            write_archive(path, archive)
        elif not path.is_file():
            raise InputError(f"{path}: expected a folder or a zip file, found none")
        yield archive, check_archive(archive, limits)


@contextmanager
def unpack_agent(path: Path) -> Generator[UnpackedAgent]:
    """The same unpacked, with the limits that a server has unless it says otherwise."""
    with (
        open_as_archive(path, ArchiveLimits()) as (archive, manifest),
        tempfile.TemporaryDirectory(prefix="mdrive-team-") as made,
    ):
        scratch = Path(made)
        scratch.chmod(0o755)  # boxes run as other users
        extract_archive(archive, manifest, scratch / "agent")
        yield UnpackedAgent(manifest, scratch / "agent")


def write_archive(folder: Path, archive: Path) -> None:
    """Writes an archive; raises ArchiveRefused for links, which no archive may hold."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as made:
        for path in sorted(folder.rglob("*")):
            name = path.relative_to(folder)
            if any(part in SKIPPED for part in name.parts):
                continue
            if path.is_symlink():
                raise ArchiveRefused(f"{path}: expected a file or a folder, found a symbolic link")
            if path.is_file():
                info = zipfile.ZipInfo(name.as_posix(), EPOCH)
                info.external_attr = 0o100644 << 16
                info.compress_type = zipfile.ZIP_DEFLATED
                with path.open("rb") as source, made.open(info, "w") as target:
                    while piece := source.read(1 << 20):
                        target.write(piece)
