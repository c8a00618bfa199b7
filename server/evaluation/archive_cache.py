"""Archives unpacked once for all their jobs. Sandboxes see the folder read-only, so it does not change."""

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import make_parents, write_text
from server.archive import ArchiveLimits, Manifest, check_archive, extract_archive
from server.enums import ChallengeTrack
from server.evaluation.job_task import JobTask

AGENT_FOLDER, MANIFEST_FILE = "agent", "manifest.json"
MIN_AGE_S = {"unpacked": 3600.0, "stage": 86400.0}
"""Minimum age of deleted folders [s]: younger ones may be in use. A job may take hours, but not a day."""


def unpack_archive(task: JobTask) -> tuple[Manifest, Path]:
    """Return the manifest and the folder of the unpacked archive. Raises ArchiveRefused, WorldError, OSError."""
    home = task.unpacked
    if not home.is_dir():
        _unpack(task, home)
    with suppress(FileNotFoundError):
        os.utime(home)
    return _load_manifest(json.loads(read_text(home / MANIFEST_FILE))), home / AGENT_FOLDER


def delete_stale(data: Path, needed: Collection[str], now_s: float | None = None) -> None:
    """Delete unpacked archives that no unfinished submission needs (`needed`: checksums), and files of dead workers."""
    now_s = time.time() if now_s is None else now_s
    for name, min_age_s in MIN_AGE_S.items():
        for folder in (data / name).glob("*/"):
            with suppress(FileNotFoundError):
                if folder.name not in needed and folder.stat().st_mtime < now_s - min_age_s:
                    shutil.rmtree(folder, ignore_errors=True)


def _unpack(task: JobTask, home: Path) -> None:
    """Unpack into a temporary folder and rename it: of several workers at once the first one succeeds."""
    make_parents(home)
    with task.archive.open("rb") as archive:
        if hashlib.file_digest(archive, "sha256").hexdigest() != task.archive_sha256:
            raise WorldError(f"{task.archive.name}: expected the bytes of the submission, found others")
    manifest = check_archive(task.archive, ArchiveLimits(**task.limits.archive_fields()))
    part = Path(tempfile.mkdtemp(prefix=f"{home.name}.", dir=home.parent))
    try:
        part.chmod(0o755)
        extract_archive(task.archive, manifest, part / AGENT_FOLDER)
        write_text(part / MANIFEST_FILE, json.dumps(asdict(manifest)))
        with suppress(OSError):  # another worker was first
            part.rename(home)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _load_manifest(data: dict[str, Any]) -> Manifest:
    hint = data.pop("track_hint")
    return Manifest(**data, track_hint=None if hint is None else ChallengeTrack(hint))
