"""Packs a folder as an archive and unpacks an archive."""

import tempfile
import zipfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from server.archive import ArchiveLimits, ArchiveRefused, Manifest, check_archive, extract_archive, layout

SKIPPED = ("__pycache__", ".git", ".venv", ".DS_Store", ".ipynb_checkpoints", ".pytest_cache", "runs")
"""Files and folders that are not packed."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, the oldest possible one: the same files give the same archive."""


@dataclass(frozen=True, slots=True)
class UnpackedAgent:
    """A checked and unpacked archive."""

    manifest: Manifest
    folder: Path


@contextmanager
def open_as_archive(path: Path, limits: ArchiveLimits) -> Generator[tuple[Path, Manifest]]:
    """Pack a folder or take an archive, and check it like the server. Raises ArchiveRefused and InputError."""
    with tempfile.TemporaryDirectory(prefix="mdrive-team-") as scratch:
        archive = path
        if path.is_dir():
            archive = Path(scratch) / "team.zip"
            write_archive(path, archive)
        elif not path.is_file():
            raise InputError(f"{path}: expected a folder or a zip file, found none")
        elif path.suffix == ".py":
            raise InputError(
                f"{path}: expected a folder or a zip file, found a Python file; make a folder in which it is"
                f" {layout.AGENTS} with a class Agent (`mdrive-sumo init-agent DIR` writes one)"
            )
        yield archive, check_archive(archive, limits)


@contextmanager
def unpack_agent(path: Path) -> Generator[UnpackedAgent]:
    """Check with a server's default limits and unpack into a temporary folder."""
    with (
        open_as_archive(path, ArchiveLimits()) as (archive, manifest),
        tempfile.TemporaryDirectory(prefix="mdrive-team-") as made,
    ):
        scratch = Path(made)
        scratch.chmod(0o755)  # sandboxes run as other users
        extract_archive(archive, manifest, scratch / "agent")
        yield UnpackedAgent(manifest, scratch / "agent")


def write_archive(folder: Path, archive: Path) -> None:
    """Write an archive of a folder. Raises ArchiveRefused for links, which are not allowed."""
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
