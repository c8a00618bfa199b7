"""Deletes old archives and recordings by a policy. Rows of the database are never deleted."""

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

_MIN_AGE_US = DAY_US
"""Minimum age of deleted files [us]: an unknown younger file may be an upload that is just being accepted."""


@dataclass(frozen=True, slots=True)
class RetentionPolicy:
    """Retention in days after a submission's end. Submissions on a leaderboard keep their files."""

    archive_days: int = 365
    """Archives of finished submissions: an admin can run them again during this time."""
    refused_days: int = 30
    """Archives of rejected, cancelled and failed submissions."""
    recording_days: int = 90


@dataclass(frozen=True, slots=True)
class RetainedFiles:
    """Files that are retained."""

    archives: frozenset[str]
    """SHA-256 of each archive: the file is `archives/<sha256>.zip`."""
    recordings: frozenset[str]
    """Ids of submissions: the folder is `recordings/<submission>`."""


def select_retained(session: Session, policy: RetentionPolicy, now_us: int) -> RetainedFiles:
    """Return what the policy retains; an archive stays as long as any submission needs it."""
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
    """Delete everything else from the data folder; return the deleted paths."""
    deleted = [*_list_expired(data / "archives", retained.archives, now_us)]
    deleted += _list_expired(data / "recordings", retained.recordings, now_us)
    for path in deleted:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return deleted


def _list_expired(folder: Path, retained: frozenset[str], now_us: int) -> Iterator[Path]:
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        is_young = now_us < path.lstat().st_mtime_ns // 1000 + _MIN_AGE_US
        if path.stem not in retained and not is_young:
            yield path
