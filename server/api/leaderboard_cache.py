"""Cache of leaderboards in the form in which they are sent: they are read far more often than they change."""

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from time import monotonic
from typing import Any, Protocol, TypeVar

from sqlalchemy.orm import Session

from server.api.leaderboards import BoardKey, list_boards, read_leaderboard
from server.api.problems import ProblemError
from server.api.subprocess_runner import SubprocessRunner
from server.store import NotFound, Store, StoreUnavailable, audit

READ_S = 30.0
"""Time limit of one read [s]."""
NICE = 5
"""Niceness of the reading process: requests come first and get the cached boards meanwhile."""
_IRRELEVANT_ACTIONS = (
    *("token-issued", "token-revoked", "team-created", "submission-accepted", "spot-check"),
    *("webhook-set", "webhook-removed"),
)
"""Actions of the audit log that change no leaderboard; every other action may."""
_Content = TypeVar("_Content")


class DatabaseReader(Protocol):
    """Reads from a database, one call at a time."""

    def read(self, build: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """Return the current stamp, and `build(session)` unless the stamp equals `stamp`.

        The stamp is the hash of the last audit entry that may have changed a board. Raises StoreUnavailable and what
        `build` raises.
        """
        ...

    def close(self) -> None:
        """End the reader."""
        ...


class DirectDatabaseReader:
    """Reads in this process."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def read(self, build: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See `DatabaseReader`."""
        return read_if_changed(self._store, build, stamp)

    def close(self) -> None:
        """See `DatabaseReader`."""


class SubprocessDatabaseReader:
    """Reads in a subprocess: a reading thread would hold the interpreter lock and delay all requests."""

    def __init__(self, url: str) -> None:
        """Prepare to read the database at `url`; the process starts with the first call."""
        self._url, self._runner = url, SubprocessRunner(1, NICE)

    def read(self, build: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See `DatabaseReader`. `build` is pickled. Raises ProblemError, too."""
        return self._runner.call(READ_S, _read_in_child, self._url, build, stamp)

    def close(self) -> None:
        """See `DatabaseReader`."""
        self._runner.close()


def read_if_changed(
    store: Store, build: Callable[[Session], _Content], stamp: str | None
) -> tuple[str, _Content | None]:
    """See `DatabaseReader.read`."""
    with store.read() as session:
        now = audit.find_last(session, _IRRELEVANT_ACTIONS)
        return now, build(session) if now != stamp else None


@lru_cache(maxsize=1)
def _open_store(url: str) -> Store:
    return Store(url)


def _read_in_child(url: str, build: Callable[[Session], _Content], stamp: str | None) -> tuple[str, _Content | None]:
    return read_if_changed(_open_store(url), build, stamp)


FRESH_US = 1_000_000
"""Age up to which an entry is returned without checking the database for changes [us]."""
STALE_US = 10_000_000
"""Age up to which an entry is returned while it is being checked [us]."""
REFRESH_S = 1.0
"""Pause between refreshes of all boards [s]; a refresh that takes longer is followed by a pause as long as itself."""
_MAX_ENTRIES = 500
"""Clients can request any number of different views."""
_Content = TypeVar("_Content")
BoardBuilder = Callable[[BoardKey, int], Awaitable[object]]
"""Builds and caches one form of a board as of a time [us since 1970]."""


@dataclass(frozen=True, slots=True)
class _CacheEntry:
    content: Any
    stamp: str
    """Hash of the last audit entry that may have changed the content: nothing changes a board without an entry."""
    checked_us: int


class LeaderboardCache:
    """Caches the boards of one store and what is made of them (pages, lists of phases). Belongs to one event loop."""

    def __init__(self, reader: DatabaseReader) -> None:
        """Take over the reader: `close` closes it."""
        self._reader = reader
        self.generation = 0
        """Number of calls of `invalidate`: what was made of an older one may show what is hidden now."""
        self._builders: list[BoardBuilder] = [partial(self.get_json, stale_us=FRESH_US)]
        self._entries: dict[Hashable, _CacheEntry] = {}
        self._tasks: dict[Hashable, asyncio.Task[Any]] = {}
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="boards")

    def add_builder(self, builder: BoardBuilder) -> None:
        """Keep another form of all boards fresh."""
        self._builders.append(builder)

    async def refresh_all(self, now: Callable[[], int]) -> None:
        """Refresh every board of the open phases one by one; requests come in between.

        Skips what cannot be built: the request for it gets the error.
        """
        with suppress(StoreUnavailable, ProblemError, OSError):
            boards, at_us = await self.get("boards", list_boards, now(), FRESH_US), now()
            open_now = [board.key for board in boards if board.opens_us <= at_us < board.closes_us]
            for key in open_now[: _MAX_ENTRIES // (2 * len(self._builders))]:
                for build in self._builders:
                    with suppress(NotFound):
                        await build(key, now())

    async def refresh_forever(self, now: Callable[[], int]) -> None:
        """Refresh all boards periodically, so that simultaneous first requests do not wait for each other."""
        while True:
            begun_s = monotonic()
            await self.refresh_all(now)
            await asyncio.sleep(max(REFRESH_S, monotonic() - begun_s))

    async def get_json(self, key: BoardKey, now_us: int, stale_us: int = STALE_US) -> bytes:
        """Return a `LeaderboardOut` as JSON. Raises NotFound and StoreUnavailable."""
        return await self.get(key, partial(_build_json, key=key), now_us, stale_us)

    async def get(
        self, key: Hashable, build: Callable[[Session], _Content], now_us: int, stale_us: int = STALE_US
    ) -> _Content:
        """Return the cached result of `build`, which depends on the key and the database only.

        An entry older than `stale_us` is checked first; a younger one is returned while it is checked. Raises what
        `build` raises.
        """
        entry = self._entries.get(key)
        age_us = abs(now_us - entry.checked_us) if entry else stale_us
        if entry is not None and age_us < FRESH_US:
            return entry.content
        task = self._tasks.get(key)
        if task is None or task.get_loop() is not asyncio.get_running_loop():
            task = self._tasks[key] = asyncio.create_task(self._check(key, build, now_us))
            task.add_done_callback(lambda done: self._remove_task(key, done))
        if entry is not None and age_us < stale_us:
            return entry.content
        return await asyncio.shield(task)  # a client that disconnects must not cancel it for the others

    def close(self) -> None:
        """Stop building, and close the reader."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        self._reader.close()

    def invalidate(self) -> None:
        """Drop all entries, also those being built: the next request sees the change just made."""
        self._entries, self._tasks = {}, {}
        self.generation += 1

    async def _check(self, key: Hashable, build: Callable[[Session], object], now_us: int) -> Any:
        return await asyncio.get_running_loop().run_in_executor(
            self._thread, self._check_in_thread, self._entries, key, build, now_us
        )

    def _check_in_thread(
        self, entries: dict[Hashable, _CacheEntry], key: Hashable, build: Callable[[Session], object], now_us: int
    ) -> Any:
        """Return the current content of an entry; an unchanged stamp also renews all other entries of that stamp."""
        old = entries.get(key)
        if old is not None and abs(now_us - old.checked_us) < FRESH_US:
            return old.content
        stamp, content = self._reader.read(build, old.stamp if old is not None else None)
        new = replace(old, checked_us=now_us) if old and old.stamp == stamp else _CacheEntry(content, stamp, now_us)
        if len(entries) >= _MAX_ENTRIES:  # the boards that are refreshed were inserted first
            for other in list(entries)[_MAX_ENTRIES // 2 :]:
                del entries[other]
        entries[key] = new
        for other, entry in list(entries.items()):
            if entry.stamp == new.stamp:
                entries[other] = replace(entry, checked_us=now_us)
        return new.content

    def _remove_task(self, key: Hashable, done: asyncio.Task[Any]) -> None:
        if self._tasks.get(key) is done:
            del self._tasks[key]
        if not done.cancelled():
            done.exception()  # mark it as retrieved: perhaps nothing awaits the task


def _build_json(session: Session, key: BoardKey) -> bytes:
    return read_leaderboard(session, key).model_dump_json().encode()
