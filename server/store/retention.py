"""Deletes old archives, recordings and results of single scenarios by a policy. Rows of submissions stay."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from server.clock import DAY_US, day_start_us
from server.enums import SubmissionState
from server.store import queries, webhooks, worker_time
from server.store.engine import Store
from server.store.quota import UNFINISHED
from server.store.tables import EventRow, JobOverviewRow, JobRow, RefusedUploadRow, SubmissionRow, WorkerTimeRow

_MIN_AGE_US = DAY_US
"""Minimum age of deleted files [us]: an unknown younger file may be an upload that is just being accepted."""


@dataclass(frozen=True, slots=True)
class RetentionPolicy:
    """Retention in days after a submission's end. Submissions on a leaderboard keep everything."""

    archive_days: int = 365
    """Archives of finished submissions: an admin can run them again during this time."""
    refused_days: int = 30
    """Archives of rejected, cancelled and failed submissions."""
    recording_days: int = 90
    """Recordings and logs of all submissions."""
    result_days: int = 365
    """Results of single scenarios, and events; the summary stays."""


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


def delete_expired_rows(store: Store, policy: RetentionPolicy, now_us: int) -> int:
    """Delete results, usage and events of submissions whose time is over; return of how many.

    One short transaction for each submission, so that no other writer waits.
    """
    with store.read() as session:
        expired = _find_expired_submissions(session, policy, now_us)
    for submission in expired:
        with store.write() as session:
            jobs = update(JobRow).where(JobRow.is_of(submission))
            session.execute(jobs.values(result=None, usage=None), execution_options={"synchronize_session": False})
            for table in (JobOverviewRow, EventRow):
                session.execute(delete(table).where(table.submission == submission))
    with store.write() as session:
        session.execute(delete(RefusedUploadRow).where(RefusedUploadRow.at_us < day_start_us(now_us) - DAY_US))
        forgotten_us = now_us - 40 * worker_time.HALF_LIFE_US
        session.execute(delete(WorkerTimeRow).where(WorkerTimeRow.at_us < forgotten_us))
        webhooks.delete_old(session, now_us)
    return len(expired)


def _find_expired_submissions(session: Session, policy: RetentionPolicy, now_us: int) -> list[str]:
    has_rows = exists().where(JobOverviewRow.submission == SubmissionRow.id)
    has_events = exists().where(EventRow.submission == SubmissionRow.id)
    old = select(SubmissionRow.id).where(
        SubmissionRow.state.not_in(UNFINISHED),
        SubmissionRow.finished_us < now_us - policy.result_days * DAY_US,
        has_rows | has_events,
    )
    standing = queries.find_standing_ids(session)
    return [id_ for id_ in session.scalars(old) if id_ not in standing]


def _list_expired(folder: Path, retained: frozenset[str], now_us: int) -> Iterator[Path]:
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        is_young = now_us < path.lstat().st_mtime_ns // 1000 + _MIN_AGE_US
        if path.stem not in retained and not is_young:
            yield path
