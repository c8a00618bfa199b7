"""Who drives: workers and dispatchers sign in with every heartbeat, so that an admin sees who lives."""

import socket
from collections.abc import Sequence

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from mdrive_sumo import __version__
from server.store.tables import Worker

FORGOTTEN_US = 3_600_000_000
"""So long one that went silent is still listed."""


def seen(session: Session, owner: str, scheduler: str, now_us: int) -> None:
    """It lives. Those silent for an hour are forgotten."""
    session.execute(delete(Worker).where(Worker.seen_us < now_us - FORGOTTEN_US))
    worker = session.get(Worker, owner)
    if worker is None:
        host = socket.gethostname()[:80]
        worker = Worker(owner=owner, host=host, version=__version__, scheduler=scheduler[:120], started_us=now_us)
        session.add(worker)
    worker.seen_us = now_us


def gone(session: Session, owner: str) -> None:
    """It ended in good order."""
    session.execute(delete(Worker).where(Worker.owner == owner))


def alive(session: Session, lease_us: int, now_us: int) -> int:
    """How many have been seen within a lease."""
    return session.scalar(select(func.count()).select_from(Worker).where(Worker.seen_us >= now_us - lease_us)) or 0


def every(session: Session) -> Sequence[Worker]:
    """The oldest first."""
    return session.scalars(select(Worker).order_by(Worker.started_us, Worker.owner)).all()
