"""Leaderboards, kept as they are sent until something happens: they are read far more often than they change."""

import asyncio
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from sqlalchemy.orm import Session

from server.api import schemas, views
from server.api.schemas import moment
from server.store import Store, audit, models, phases, published, queries
from server.words import Track

FRESH_US = 1_000_000
"""So long a board is handed out without asking the database whether anything happened."""
STALE_US = 4_000_000
"""So long it is still handed out while it is looked after; a board that nobody asked for is not as old as that."""
_MOST = 500
"""Things that are kept; what clients ask for is without end."""
_Kept = TypeVar("_Kept")


@dataclass(frozen=True, slots=True)
class Which:
    """One board."""

    phase: str
    track: Track | None
    """None: all in which every CAV decides for itself."""
    bucket: str | None
    category: str | None


@dataclass(frozen=True, slots=True)
class _Made:
    content: Any
    stamp: str
    """Head of the audit log: nothing changes a board without an entry there."""
    checked_us: int


class Boards:
    """Of one store; for one event loop. What is made of boards is kept here, too: pages, lists of phases."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._made: dict[Hashable, _Made] = {}
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        # Python computes one at a time anyway: more threads would only keep each other and all answers waiting.
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="boards")

    async def board(self, which: Which, now_us: int) -> bytes:
        """JSON of `schemas.Leaderboard`. Raises NotFound and StoreUnavailable."""
        return await self.kept(which, lambda session: read(session, which).model_dump_json().encode(), now_us)

    async def kept(self, key: Hashable, make: Callable[[Session], _Kept], now_us: int) -> _Kept:
        """What `make` makes (always the same for a key and the same database); raises what it raises."""
        found = self._made.get(key)
        age_us = abs(now_us - found.checked_us) if found else STALE_US
        if found is not None and age_us < FRESH_US:
            return found.content
        task = self._tasks.get(key)
        if task is None or task.get_loop() is not asyncio.get_running_loop():
            task = self._tasks[key] = asyncio.create_task(self._renew(key, make, now_us))
            task.add_done_callback(lambda done: self._forget_task(key, done))
        if found is not None and age_us < STALE_US:
            return found.content
        return await asyncio.shield(task)  # a client that leaves does not take it from the others

    def close(self) -> None:
        """Nothing new is made from now on."""
        self._reader.shutdown(cancel_futures=True)

    def forget(self) -> None:
        """After a deed that is to be seen at once."""
        self._made.clear()

    async def _renew(self, key: Hashable, make: Callable[[Session], object], now_us: int) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._reader, self._looked_after, key, make, now_us)

    def _looked_after(self, key: Hashable, make: Callable[[Session], object], now_us: int) -> Any:
        """By the reader. Where nothing happened, all that is kept has been looked after at once."""
        old = self._made.get(key)
        if old is not None and abs(now_us - old.checked_us) < FRESH_US:
            return old.content
        found = renewed(self._store, make, old, now_us)
        if len(self._made) >= _MOST:
            self._made.clear()
        self._made[key] = found
        for other, made in list(self._made.items()):
            if made.stamp == found.stamp:
                self._made[other] = replace(made, checked_us=now_us)
        return found.content

    def _forget_task(self, key: Hashable, done: asyncio.Task[Any]) -> None:
        if self._tasks.get(key) is done:
            del self._tasks[key]
        if not done.cancelled():
            done.exception()  # whoever waits has it; nobody may wait


def renewed(store: Store, make: Callable[[Session], object], old: _Made | None, now_us: int) -> _Made:
    """The old one, if nothing happened since; else a new one. Raises NotFound and StoreUnavailable."""
    with store.read() as session:
        stamp = audit.head(session)
        if old is not None and old.stamp == stamp:
            return replace(old, checked_us=now_us)
        return _Made(make(session), stamp, now_us)


def read(session: Session, which: Which) -> schemas.Leaderboard:
    """A board, from the database. Raises NotFound."""
    phase = phases.get(session, which.phase)
    rows = queries.leaderboard(session, phase.id, which.track, which.bucket, which.category)
    whole = which.bucket is None and which.category is None
    told = [_row(row) for row in rows if whole or _may_be_told(session, phase, which, row)]
    paper = [_row(row) for row in published.rows(which.track, which.bucket, which.category)]
    return schemas.Leaderboard(
        phase=which.phase,
        track=which.track,
        bucket=which.bucket,
        category=which.category,
        rows=told,
        published=paper,
    )


def _may_be_told(session: Session, phase: models.Phase, which: Which, row: queries.Row) -> bool:
    """Of a bucket or category, which depends on what else the submission has."""
    submission = session.get(models.Submission, row.submission) if not phase.public else None
    if submission is None or submission.summary is None:
        return phase.public
    parts = submission.summary["buckets" if which.bucket is not None else "categories"]
    return (which.bucket or which.category) in views.tellable(phase, parts)


def _row(row: queries.Row) -> schemas.Row:
    return schemas.Row(
        rank=row.rank,
        team=row.team,
        method=row.method,
        track=Track(row.track),
        submission=row.submission,
        figures=schemas.Figures.model_validate(row.figures),
        created=moment(row.created_us) if row.created_us is not None else None,
        published=row.published,
    )
