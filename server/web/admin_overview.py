"""What an admin looks at: the queue, who drives, the audit log, the disk."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.enums import JobState
from server.settings import ServerSettings
from server.store import Store, audit, queries, tables, workers
from server.store.quota import UNFINISHED

ENTRIES = 30
"""Latest ones of a list that are shown."""
MOST_UNFINISHED = 200


@dataclass(frozen=True, slots=True)
class QueuedSubmission:
    """An unfinished submission."""

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
    """A job that is running."""

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
    """None for one that never signed in."""
    silent_us: int | None
    """Since it was last seen."""
    lost: bool
    """Silent for longer than a lease: it is dead, or its database is."""
    jobs: tuple[RunningJob, ...]


@dataclass(frozen=True, slots=True)
class FolderUsage:
    """A part of the data folder."""

    name: str
    files: int
    bytes: int


@dataclass(frozen=True, slots=True)
class DiskUsage:
    """What the data take."""

    folders: tuple[FolderUsage, ...]
    free: int
    total: int


def list_queue(session: Session) -> list[QueuedSubmission]:
    """Unfinished submissions, the oldest first."""
    wanted = select(tables.SubmissionRow).where(tables.SubmissionRow.state.in_(UNFINISHED))
    order = (tables.SubmissionRow.created_us, tables.SubmissionRow.id)
    found: list[QueuedSubmission] = []
    for each in session.scalars(wanted.order_by(*order).limit(MOST_UNFINISHED)):
        counts = queries.count_jobs(session, each.id)
        team = session.get(tables.TeamRow, each.team)
        found.append(
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
    return found


def list_workers(session: Session, settings: ServerSettings, now_us: int) -> list[WorkerStatus]:
    """Who signed in within the last hour, and whoever else holds a job."""
    running: dict[str, list[RunningJob]] = {}
    for job in session.scalars(
        select(tables.JobRow).where(tables.JobRow.state == JobState.RUNNING).order_by(tables.JobRow.id)
    ):
        driven = RunningJob(
            job.submission, job.scenario, job.seed, job.attempt, job.started_us or now_us, job.lease_us or now_us
        )
        running.setdefault(job.owner or "", []).append(driven)
    lease_us = settings.work.lease_s * 1_000_000
    known = [
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
    return known + [WorkerStatus(owner, "", "", "", None, None, False, tuple(jobs)) for owner, jobs in running.items()]


def list_entries(session: Session, action: str | None = None) -> Sequence[tables.AuditEntryRow]:
    """The latest of the audit log, or of one kind in it."""
    return audit.list_latest(session, ENTRIES, action)


def list_finished(session: Session) -> Sequence[tuple[tables.SubmissionRow, str]]:
    """The last submissions that ended, and their teams' names."""
    named = select(tables.SubmissionRow, tables.TeamRow.name).join(
        tables.TeamRow, tables.TeamRow.id == tables.SubmissionRow.team
    )
    ended = named.where(tables.SubmissionRow.finished_us.is_not(None))
    return session.execute(ended.order_by(tables.SubmissionRow.finished_us.desc()).limit(ENTRIES)).all()


def verify_chain(store: Store) -> audit.AuditReport:
    """Walks the whole audit log."""
    with store.read() as session:
        return audit.verify_chain(session)


def measure_disk(data: Path) -> DiskUsage:
    """Looks at every file. Raises OSError where the folder is not there."""
    folders = [_measure_folder(path) for path in sorted(data.iterdir()) if path.is_dir() and not path.is_symlink()]
    loose = [path.lstat().st_size for path in data.iterdir() if path.is_file()]
    usage = shutil.disk_usage(data)
    return DiskUsage(
        (*folders, FolderUsage("database and loose files", len(loose), sum(loose))), usage.free, usage.total
    )


def _measure_folder(path: Path) -> FolderUsage:
    files = size = 0
    for root, _, names in os.walk(path):
        for name in names:
            try:
                size += (Path(root) / name).lstat().st_size
            except FileNotFoundError:  # cleared up meanwhile
                continue
            files += 1
    return FolderUsage(path.name, files, size)
