"""What of the files on disk may go: archives and recordings, by a policy. Rows of the database always stay."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.clock import DAY_US
from server.enums import SubmissionState
from server.store import queries
from server.store.quota import UNFINISHED
from server.store.tables import SubmissionRow

_UPLOAD_US = DAY_US
"""A file nobody knows may be an upload that is being taken in: whoever takes one in replaces the file, old or not."""


@dataclass(frozen=True, slots=True)
class RetentionPolicy:
    """Days after a submission's end. What stands on a leaderboard keeps its files always."""

    archive_days: int = 365
    """Of finished submissions: an admin can run them again so long."""
    refused_days: int = 30
    """Archives of rejected, cancelled and failed submissions."""
    recording_days: int = 90


@dataclass(frozen=True, slots=True)
class RetainedFiles:
    """What must stay."""

    archives: frozenset[str]
    """SHA-256 of each: the file is `archives/<sha256>.zip`."""
    recordings: frozenset[str]
    """Submissions: the folder is `recordings/<submission>`."""


def select_retained(session: Session, policy: RetentionPolicy, now_us: int) -> RetainedFiles:
    """By the policy; an archive stays as long as any submission needs it."""
    standing = queries.find_standing_ids(session)
    archives: set[str] = set()
    recordings: set[str] = set()
    columns = (SubmissionRow.id, SubmissionRow.archive_sha256, SubmissionRow.state, SubmissionRow.finished_us)
    for id_, sha256, state, finished_us in session.execute(select(*columns)):
        always = state in UNFINISHED or id_ in standing
        age_us = now_us - (finished_us or now_us)
        days = (
            policy.archive_days
            if state in (SubmissionState.DONE, SubmissionState.DISQUALIFIED)
            else policy.refused_days
        )
        if always or age_us < days * DAY_US:
            archives.add(sha256)
        if always or age_us < policy.recording_days * DAY_US:
            recordings.add(id_)
    return RetainedFiles(frozenset(archives), frozenset(recordings))


def delete_expired(retained: RetainedFiles, data: Path, now_us: int) -> list[Path]:
    """Deletes from `data` what need not stay; returns what it deleted."""
    deleted = [*_list_expired(data / "archives", retained.archives, now_us)]
    deleted += _list_expired(data / "recordings", retained.recordings, now_us)
    for path in deleted:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return deleted


def _list_expired(folder: Path, stay: frozenset[str], now_us: int) -> Iterator[Path]:
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        young = now_us < path.lstat().st_mtime_ns // 1000 + _UPLOAD_US
        if path.stem not in stay and not young:
            yield path
