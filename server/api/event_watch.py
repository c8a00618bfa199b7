"""Which streams of events have something to read: one look at the database for all of them.

If each stream read its own events once a second, 255 streams that began together would occupy all threads for a quarter
of each second.
"""

import asyncio
from time import monotonic

from sqlalchemy import func, select
from starlette.concurrency import run_in_threadpool

from server.store import Store
from server.store.tables import AuditEntryRow, EventRow

REFRESH_S = 0.5
"""Age from which the next stream looks again [s]; streams ask once a second."""


class EventWatch:
    """Knows the last event of each submission, and the tokens revoked, since `begin`. Belongs to one event loop."""

    def __init__(self) -> None:
        self._last_by_submission: dict[str, int] = {}
        self._revoked: set[str] = set()
        self._event = self._entry = -1
        self._looked_at_s = 0.0
        self._lock = asyncio.Lock()

    async def begin(self, store: Store) -> None:
        """Look for the first time; call it before a stream reads its first events. Raises StoreUnavailable."""
        if self._event < 0:
            await self._refresh(store)

    async def has_news(self, store: Store, submission: str, after: int, token: str) -> bool:
        """Return whether a submission has events after the one of id `after`, or the token was revoked.

        Raises StoreUnavailable.
        """
        await self._refresh(store)
        return self._last_by_submission.get(submission, -1) > after or token in self._revoked

    async def _refresh(self, store: Store) -> None:
        async with self._lock:
            if self._event < 0 or monotonic() - self._looked_at_s >= REFRESH_S:
                await run_in_threadpool(self._look, store)
                self._looked_at_s = monotonic()

    def _look(self, store: Store) -> None:
        with store.read() as session:
            if self._event < 0:
                self._event = session.scalar(select(func.max(EventRow.id))) or 0
                self._entry = session.scalar(select(func.max(AuditEntryRow.id))) or 0
                return
            new = select(EventRow.submission, func.max(EventRow.id)).where(EventRow.id > self._event)
            rows = session.execute(new.group_by(EventRow.submission)).all()
            last_by_submission: dict[str, int] = {row[0]: row[1] for row in rows}
            self._last_by_submission |= last_by_submission
            self._event = max(last_by_submission.values(), default=self._event)
            entries = session.execute(
                select(AuditEntryRow.id, AuditEntryRow.action, AuditEntryRow.data).where(AuditEntryRow.id > self._entry)
            ).all()
            self._revoked |= {entry.data["token"] for entry in entries if entry.action == "token-revoked"}
            self._entry = max((entry.id for entry in entries), default=self._entry)
