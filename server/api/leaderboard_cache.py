"""Leaderboards, kept as they are sent until something happens: they are read far more often than they change."""

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from time import monotonic
from typing import Any, TypeVar

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.api import schemas, submission_views
from server.api.database_reader import DatabaseReader
from server.api.problems import ProblemError
from server.api.schemas import to_datetime
from server.enums import ChallengeTrack
from server.store import NotFound, StoreUnavailable, phases, published_results, queries, tables

FRESH_US = 1_000_000
"""So long a board is handed out without asking the database whether anything happened."""
STALE_US = 10_000_000
"""So long it is still handed out while it is looked after."""
REFRESH_S = 1.0
"""So often boards that have changed are made anew; where that takes longer, half of the time."""
_MAX_ENTRIES = 500
"""Things that are kept; what clients ask for is without end."""
_Content = TypeVar("_Content")


@dataclass(frozen=True, slots=True)
class BoardKey:
    """One board."""

    phase: str
    track: ChallengeTrack | None
    """None: all in which every CAV decides for itself."""
    bucket: str | None
    category: str | None


@dataclass(frozen=True, slots=True)
class PhaseParts:
    """Of a phase: what it has boards of, beside the whole."""

    buckets: tuple[str, ...]
    categories: tuple[str, ...]


BoardBuilder = Callable[[BoardKey, int], Awaitable[object]]
"""Makes a board in a form in which it is sent, to be kept; as it is at that time [us]."""


@dataclass(frozen=True, slots=True)
class _CacheEntry:
    content: Any
    stamp: str
    """Of the audit log's last entry that may have changed it: nothing changes a board without one."""
    checked_us: int


class LeaderboardCache:
    """Of one store; for one event loop. What is made of boards is kept here, too: pages, lists of phases."""

    def __init__(self, reader: DatabaseReader) -> None:
        """Owns the reader."""
        self._reader = reader
        self._makers: list[BoardBuilder] = [partial(self.board, stale_us=FRESH_US)]
        self._made: dict[Hashable, _CacheEntry] = {}
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="boards")

    def also(self, make: BoardBuilder) -> None:
        """Has another form of all boards kept ready."""
        self._makers.append(make)

    async def make_all(self, now: Callable[[], int]) -> None:
        """Every board of the open phases, one after the other: what somebody asks for meanwhile comes in between.

        What cannot be made is left out: whoever asks for it is told why.
        """
        with suppress(StoreUnavailable, ProblemError, OSError):
            every, at_us = await self.kept("every", _list_boards, now(), FRESH_US), now()
            open_now = [which for opens_us, closes_us, which in every if opens_us <= at_us < closes_us]
            for which in open_now[: _MAX_ENTRIES // (2 * len(self._makers))]:
                for make in self._makers:
                    with suppress(NotFound):
                        await make(which, now())

    async def keep(self, now: Callable[[], int]) -> None:
        """Makes all again and again, without end, or the first who ask at once would wait for each other."""
        while True:
            begun_s = monotonic()
            await self.make_all(now)
            await asyncio.sleep(max(REFRESH_S, monotonic() - begun_s))

    async def board(self, which: BoardKey, now_us: int, stale_us: int = STALE_US) -> bytes:
        """JSON of `schemas.Leaderboard`. Raises NotFound and StoreUnavailable."""
        return await self.kept(which, partial(_build_json, which=which), now_us, stale_us)

    async def kept(
        self, key: Hashable, make: Callable[[Session], _Content], now_us: int, stale_us: int = STALE_US
    ) -> _Content:
        """What `make` makes (always the same for a key and the same database); raises what it raises.

        stale_us: so long it was not looked after when it is no longer handed out before that is done.
        """
        found = self._made.get(key)
        age_us = abs(now_us - found.checked_us) if found else stale_us
        if found is not None and age_us < FRESH_US:
            return found.content
        task = self._tasks.get(key)
        if task is None or task.get_loop() is not asyncio.get_running_loop():
            task = self._tasks[key] = asyncio.create_task(self._renew(key, make, now_us))
            task.add_done_callback(lambda done: self._forget_task(key, done))
        if found is not None and age_us < stale_us:
            return found.content
        return await asyncio.shield(task)  # a client that leaves does not take it from the others

    def close(self) -> None:
        """Nothing new is made from now on."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        self._reader.close()

    def forget(self) -> None:
        """After a deed that is to be seen at once. What is being made is of before the deed, and forgotten, too."""
        self._made, self._tasks = {}, {}

    async def _renew(self, key: Hashable, make: Callable[[Session], object], now_us: int) -> Any:
        return await asyncio.get_running_loop().run_in_executor(
            self._thread, self._looked_after, self._made, key, make, now_us
        )

    def _looked_after(
        self, kept: dict[Hashable, _CacheEntry], key: Hashable, make: Callable[[Session], object], now_us: int
    ) -> Any:
        """Where nothing happened, all that is kept has been looked after at once."""
        old = kept.get(key)
        if old is not None and abs(now_us - old.checked_us) < FRESH_US:
            return old.content
        stamp, content = self._reader.look(make, old.stamp if old is not None else None)
        found = replace(old, checked_us=now_us) if old and old.stamp == stamp else _CacheEntry(content, stamp, now_us)
        if len(kept) >= _MAX_ENTRIES:  # what is asked for always was there first
            for other in list(kept)[_MAX_ENTRIES // 2 :]:
                del kept[other]
        kept[key] = found
        for other, made in list(kept.items()):
            if made.stamp == found.stamp:
                kept[other] = replace(made, checked_us=now_us)
        return found.content

    def _forget_task(self, key: Hashable, done: asyncio.Task[Any]) -> None:
        if self._tasks.get(key) is done:
            del self._tasks[key]
        if not done.cancelled():
            done.exception()  # whoever waits has it; nobody may wait


def _build_json(session: Session, which: BoardKey) -> bytes:
    return read_leaderboard(session, which).model_dump_json().encode()


def read_leaderboard(session: Session, which: BoardKey) -> schemas.LeaderboardOut:
    """A board, from the database. Raises NotFound."""
    phase = phases.get(session, which.phase)
    rows = queries.find_leaderboard(session, phase.id, which.track, which.bucket, which.category)
    whole = which.bucket is None and which.category is None
    told = [_to_row(row) for row in rows if whole or _is_disclosable(session, phase, which, row)]
    paper = [_to_row(row) for row in published_results.list_published(which.track, which.bucket, which.category)]
    return schemas.LeaderboardOut(
        phase=which.phase,
        track=which.track,
        bucket=which.bucket,
        category=which.category,
        rows=told,
        published=paper,
    )


def list_parts(session: Session, phase_id: str) -> PhaseParts:
    """Buckets and categories that have a board which may be told. Raises NotFound."""
    phase = phases.get(session, phase_id)
    most = func.max(tables.StandingRow.figures["scenarios"].as_integer())
    slices = select(tables.StandingRow.slice, most).where(tables.StandingRow.phase == phase.id)
    found = session.execute(slices.group_by(tables.StandingRow.slice).order_by(tables.StandingRow.slice)).all()
    figures_by_part: dict[str, dict[str, dict[str, int]]] = {"bucket": {}, "category": {}}
    for name, scenarios in found:
        kind, _, part = name.partition(":")
        figures_by_part.setdefault(kind, {})[part] = {"scenarios": scenarios or 0}
    buckets, categories = (
        submission_views.disclosable_parts(phase, figures_by_part[kind]) for kind in ("bucket", "category")
    )
    return PhaseParts(
        tuple(name for name in figures_by_part["bucket"] if name in buckets),
        tuple(name for name in figures_by_part["category"] if name in categories),
    )


def _list_boards(session: Session) -> list[tuple[int, int, BoardKey]]:
    """With the times at which its phase opens and closes."""
    found: list[tuple[int, int, BoardKey]] = []
    for phase in phases.list_phases(session):
        of_phase = list_parts(session, phase.id)
        whole = [BoardKey(phase.id, track, None, None) for track in (None, *ChallengeTrack)]
        buckets = [BoardKey(phase.id, None, bucket, None) for bucket in of_phase.buckets]
        categories = [BoardKey(phase.id, None, None, category) for category in of_phase.categories]
        found += [(phase.opens_us, phase.closes_us, which) for which in (*whole, *buckets, *categories)]
    return found


def _is_disclosable(session: Session, phase: tables.PhaseRow, which: BoardKey, row: queries.LeaderboardEntry) -> bool:
    """Of a bucket or category, which depends on what else the submission has."""
    submission = session.get(tables.SubmissionRow, row.submission) if not phase.public else None
    if submission is None or submission.summary is None:
        return phase.public
    parts = submission.summary["buckets" if which.bucket is not None else "categories"]
    return (which.bucket or which.category) in submission_views.disclosable_parts(phase, parts)


def _to_row(row: queries.LeaderboardEntry) -> schemas.RowOut:
    return schemas.RowOut(
        rank=row.rank,
        team=row.team,
        method=row.method,
        track=ChallengeTrack(row.track),
        submission=row.submission,
        figures=schemas.FiguresOut.model_validate(row.figures),
        created=to_datetime(row.created_us) if row.created_us is not None else None,
        published=row.published,
    )
