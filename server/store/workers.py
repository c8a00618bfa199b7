"""Live workers and dispatchers: each writes a heartbeat, so that an admin sees which are alive."""

import socket
from collections.abc import Sequence

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from mdrive_sumo import __version__
from server.store.tables import WorkerRow

FORGET_AFTER_US = 3_600_000_000
"""Time after the last heartbeat at which a worker is no longer listed [us]."""


def record_heartbeat(session: Session, owner: str, scheduler: str, now_us: int) -> None:
    """Record a worker's heartbeat, and delete workers without one for an hour."""
    session.execute(delete(WorkerRow).where(WorkerRow.seen_us < now_us - FORGET_AFTER_US))
    worker = session.get(WorkerRow, owner)
    if worker is None:
        host = socket.gethostname()[:80]
        worker = WorkerRow(owner=owner, host=host, version=__version__, scheduler=scheduler[:120], started_us=now_us)
        session.add(worker)
    worker.seen_us = now_us


def remove_worker(session: Session, owner: str) -> None:
    """Delete a worker that ends in good order."""
    session.execute(delete(WorkerRow).where(WorkerRow.owner == owner))


def count_alive(session: Session, lease_us: int, now_us: int) -> int:
    """Return how many workers had a heartbeat within a lease."""
    return (
        session.scalar(select(func.count()).select_from(WorkerRow).where(WorkerRow.seen_us >= now_us - lease_us)) or 0
    )


def list_workers(session: Session) -> Sequence[WorkerRow]:
    """Return all workers, the oldest first."""
    return session.scalars(select(WorkerRow).order_by(WorkerRow.started_us, WorkerRow.owner)).all()
