"""Unpacks a checked archive."""

import os
import shutil
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from server.archive import layout
from server.archive.errors import ArchiveRefused
from server.archive.manifest import Manifest, compute_sha256
from server.archive.zip_reader import read_entry, translate_zip_errors

FRESH = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
FILE_MODE, FOLDER_MODE = 0o644, 0o755
"""Whatever the archive says: boxes run as other users, and none of it is run by being executable."""


def extract_archive(path: Path, manifest: Manifest, folder: Path) -> None:
    """Unpacks into `folder`, which must not exist yet; nothing stays behind if it fails.

    Raises ArchiveRefused if the file is not the one that was checked, and OSError.
    """
    if (found := compute_sha256(path)) != manifest.sha256:
        raise ArchiveRefused(f"archive: expected the one that was checked, {manifest.sha256:.12}, found {found:.12}")
    folder.mkdir()
    try:
        folder.chmod(FOLDER_MODE)  # `mkdir` asks the umask
        with translate_zip_errors(), ZipFile(path) as archive:
            for info in archive.infolist():
                if not layout.is_mac_metadata(info.filename) and not info.is_dir():
                    _extract_entry(archive, info, folder, info.filename.removeprefix(manifest.root))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _extract_entry(archive: ZipFile, info: ZipInfo, folder: Path, name: str) -> None:
    """One file. There are no links below the folder: it was fresh, and none was unpacked."""
    *parents, _ = name.split("/")
    for count in range(1, len(parents) + 1):
        parent = folder.joinpath(*parents[:count])
        parent.mkdir(exist_ok=True)
        parent.chmod(FOLDER_MODE)
    fd = os.open(folder / name, FRESH, FILE_MODE)
    with os.fdopen(fd, "wb") as file:
        os.fchmod(fd, FILE_MODE)
        file.writelines(read_entry(archive, info))
