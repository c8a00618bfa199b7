"""Events of submissions. There is one writer at a time, so a larger id was committed later."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.store.tables import EventRow


def add_event(session: Session, submission: str, kind: str, data: dict[str, Any], now_us: int) -> None:
    """Add an event. The team sees it: neither its data nor its time may disclose a hidden scenario."""
    session.add(EventRow(submission=submission, at_us=now_us, kind=kind, data=data))


def list_since(session: Session, submission: str, after_id: int = 0, limit: int = 1000) -> Sequence[EventRow]:
    """Return at most `limit` events after one already seen, the oldest first."""
    after = select(EventRow).where(EventRow.submission == submission, EventRow.id > after_id)
    return session.scalars(after.order_by(EventRow.id).limit(limit)).all()
