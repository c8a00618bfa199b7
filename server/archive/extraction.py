"""Extracts a checked archive."""

import os
import shutil
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from mdrive_sumo.core.output_files import NEW_FILE
from server.archive import layout
from server.archive.layout import ArchiveRefused
from server.archive.manifest import Manifest, compute_sha256
from server.archive.zip_reader import read_entry, translate_zip_errors

FILE_MODE, FOLDER_MODE = 0o644, 0o755
"""Modes of extracted files, whatever the archive says: sandboxes run as other users and execute no file directly."""


def extract_archive(path: Path, manifest: Manifest, folder: Path) -> None:
    """Extract into `folder`, which must not exist; it is removed again on failure.

    Raises ArchiveRefused if the file is not the one that was checked, and OSError.
    """
    if (checksum := compute_sha256(path)) != manifest.sha256:
        raise ArchiveRefused(f"archive: expected the one that was checked, {manifest.sha256:.12}, found {checksum:.12}")
    folder.mkdir()
    try:
        folder.chmod(FOLDER_MODE)  # `mkdir` applies the umask
        with translate_zip_errors(), ZipFile(path) as archive:
            for info in archive.infolist():
                if not layout.is_mac_metadata(info.filename) and not info.is_dir():
                    _extract_entry(archive, info, folder, info.filename.removeprefix(manifest.root))
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _extract_entry(archive: ZipFile, info: ZipInfo, folder: Path, name: str) -> None:
    """Extract one file. The folder contains no links: it was new, and links are refused."""
    *parents, _ = name.split("/")
    for count in range(1, len(parents) + 1):
        parent = folder.joinpath(*parents[:count])
        parent.mkdir(exist_ok=True)
        parent.chmod(FOLDER_MODE)
    fd = os.open(folder / name, NEW_FILE, FILE_MODE)
    with os.fdopen(fd, "wb") as file:
        os.fchmod(fd, FILE_MODE)
        file.writelines(read_entry(archive, info))
