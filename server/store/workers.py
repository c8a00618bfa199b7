"""Who drives: workers and dispatchers sign in with every heartbeat, so that an admin sees who lives."""

import socket
from collections.abc import Sequence

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from mdrive_sumo import __version__
from server.store.tables import WorkerRow

FORGET_AFTER_US = 3_600_000_000
"""So long one that went silent is still listed."""


def record_heartbeat(session: Session, owner: str, scheduler: str, now_us: int) -> None:
    """It lives. Those silent for an hour are forgotten."""
    session.execute(delete(WorkerRow).where(WorkerRow.seen_us < now_us - FORGET_AFTER_US))
    worker = session.get(WorkerRow, owner)
    if worker is None:
        host = socket.gethostname()[:80]
        worker = WorkerRow(owner=owner, host=host, version=__version__, scheduler=scheduler[:120], started_us=now_us)
        session.add(worker)
    worker.seen_us = now_us


def remove_worker(session: Session, owner: str) -> None:
    """It ended in good order."""
    session.execute(delete(WorkerRow).where(WorkerRow.owner == owner))


def count_alive(session: Session, lease_us: int, now_us: int) -> int:
    """How many have been seen within a lease."""
    return (
        session.scalar(select(func.count()).select_from(WorkerRow).where(WorkerRow.seen_us >= now_us - lease_us)) or 0
    )


def list_workers(session: Session) -> Sequence[WorkerRow]:
    """The oldest first."""
    return session.scalars(select(WorkerRow).order_by(WorkerRow.started_us, WorkerRow.owner)).all()
