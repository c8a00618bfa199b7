"""Data of the admin pages: queue, workers, audit log, disk."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.enums import JobKind, JobState
from server.settings import ServerSettings
from server.store import Store, audit, queries, tables, workers
from server.store.quota import UNFINISHED

ENTRIES = 30
"""Length of the lists of latest entries."""
MAX_QUEUE = 200
"""Submissions of the queue that the page lists: each needs a query of its jobs."""


@dataclass(frozen=True, slots=True)
class QueuedSubmission:
    """An unfinished submission in the queue."""

    id: str
    name: str
    team: str
    phase: str
    track: str
    state: str
    created_us: int
    done: int
    total: int


@dataclass(frozen=True, slots=True)
class RunningJob:
    """A running job."""

    submission: str
    scenario: str
    seed: int
    attempt: int
    since_us: int
    lease_us: int


@dataclass(frozen=True, slots=True)
class WorkerStatus:
    """A worker or dispatcher."""

    owner: str
    host: str
    version: str
    scheduler: str
    started_us: int | None
    """Time of its first heartbeat [us since 1970]; None if it has none."""
    silent_us: int | None
    """Time since the last heartbeat [us]; None if it has none."""
    is_lost: bool
    """Whether it is silent for longer than a lease."""
    jobs: tuple[RunningJob, ...]


@dataclass(frozen=True, slots=True)
class FolderUsage:
    """Usage of a part of the data folder."""

    name: str
    files: int
    bytes: int


@dataclass(frozen=True, slots=True)
class DiskUsage:
    """Disk usage of the data folder."""

    folders: tuple[FolderUsage, ...]
    free: int
    total: int


def list_queue(session: Session) -> list[QueuedSubmission]:
    """Return the unfinished submissions, the oldest first."""
    wanted = select(tables.SubmissionRow).where(tables.SubmissionRow.state.in_(UNFINISHED))
    order = (tables.SubmissionRow.created_us, tables.SubmissionRow.id)
    queued: list[QueuedSubmission] = []
    for each in session.scalars(wanted.order_by(*order).limit(MAX_QUEUE)):
        counts = queries.count_jobs(session, each.id)
        team = session.get(tables.TeamRow, each.team)
        queued.append(
            QueuedSubmission(
                each.id,
                each.name,
                team.name if team else each.team,
                each.phase,
                each.track,
                each.state,
                each.created_us,
                counts.get(JobState.DONE, 0),
                sum(counts.values()),
            )
        )
    return queued


def list_workers(session: Session, settings: ServerSettings, now_us: int) -> list[WorkerStatus]:
    """Return the workers with a heartbeat within the last hour, and others that hold a job."""
    running: dict[str, list[RunningJob]] = {}
    of_submissions = (tables.JobRow.state == JobState.RUNNING, tables.JobRow.kind == JobKind.SUBMISSION)
    for job in session.scalars(select(tables.JobRow).where(*of_submissions).order_by(tables.JobRow.id)):
        driven = RunningJob(
            job.submission, job.scenario, job.seed, job.attempt, job.started_us or now_us, job.lease_us or now_us
        )
        running.setdefault(job.owner or "", []).append(driven)
    lease_us = settings.work.lease_s * 1_000_000
    listed = [
        WorkerStatus(
            each.owner,
            each.host,
            each.version,
            each.scheduler,
            each.started_us,
            max(0, now_us - each.seen_us),
            now_us - each.seen_us > lease_us,
            tuple(running.pop(each.owner, ())),
        )
        for each in workers.list_workers(session)
    ]
    return listed + [WorkerStatus(owner, "", "", "", None, None, False, tuple(jobs)) for owner, jobs in running.items()]


def list_entries(session: Session, action: str | None = None) -> Sequence[tables.AuditEntryRow]:
    """Return the latest entries of the audit log, all or those of one action."""
    return audit.list_latest(session, ENTRIES, action)


def list_finished(session: Session) -> Sequence[tuple[tables.SubmissionRow, str]]:
    """Return the latest finished submissions with their teams' names."""
    named = select(tables.SubmissionRow, tables.TeamRow.name).join(
        tables.TeamRow, tables.TeamRow.id == tables.SubmissionRow.team
    )
    ended = named.where(tables.SubmissionRow.finished_us.is_not(None))
    return session.execute(ended.order_by(tables.SubmissionRow.finished_us.desc()).limit(ENTRIES)).all()


def verify_chain(store: Store) -> audit.AuditReport:
    """Verify the whole audit log."""
    with store.read() as session:
        return audit.verify_chain(session)


def measure_disk(data: Path) -> DiskUsage:
    """Measure every file. Raises OSError if the folder does not exist."""
    folders = [_measure_folder(path) for path in sorted(data.iterdir()) if path.is_dir() and not path.is_symlink()]
    other_files = [path.lstat().st_size for path in data.iterdir() if path.is_file()]
    usage = shutil.disk_usage(data)
    return DiskUsage(
        (*folders, FolderUsage("database and other files", len(other_files), sum(other_files))), usage.free, usage.total
    )


def _measure_folder(path: Path) -> FolderUsage:
    files = size = 0
    for root, _, names in os.walk(path):
        for name in names:
            try:
                size += (Path(root) / name).lstat().st_size
            except FileNotFoundError:  # deleted meanwhile
                continue
            files += 1
    return FolderUsage(path.name, files, size)
