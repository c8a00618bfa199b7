"""Read leaderboards and pages made of them from the database, in this process or in a subprocess."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from sqlalchemy.orm import Session

from server.api.subprocess_runner import SubprocessRunner
from server.store import Store, audit

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
