"""What happened to a submission, in order. There is one writer at a time, so a later id was committed later."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.store.tables import EventRow


def add_event(session: Session, submission: str, kind: str, data: dict[str, Any], now_us: int) -> None:
    """One event. What it says reaches the team: nothing of a hidden scenario may be in it, not even by its time."""
    session.add(EventRow(submission=submission, at_us=now_us, kind=kind, data=data))


def list_since(session: Session, submission: str, after_id: int = 0, most: int = 1000) -> Sequence[EventRow]:
    """Events after one already seen, the oldest first."""
    wanted = select(EventRow).where(EventRow.submission == submission, EventRow.id > after_id)
    return session.scalars(wanted.order_by(EventRow.id).limit(most)).all()
