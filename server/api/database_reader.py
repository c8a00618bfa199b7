"""Reads boards, and what is made of them, from the database: here, or in a process of its own."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from sqlalchemy.orm import Session

from server.api.subprocess_runner import SubprocessRunner
from server.store import Store, audit

READ_S = 30.0
"""Longest time for one look."""
NICE = 5
"""Of who makes boards: the old ones are handed out meanwhile."""
_IRRELEVANT_ACTIONS = ("token-issued", "token-revoked", "team-created", "submission-accepted", "spot-check")
"""Deeds that change no board. Any other may, those too that there are not yet."""
_Made = TypeVar("_Made")


class DatabaseReader(Protocol):
    """Reads boards and what is made of them from a database, one at a time."""

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """The stamp of now, and unless it is that one, what `make` makes. Raises what it raises, StoreUnavailable."""
        ...

    def close(self) -> None:
        """Nothing is read any more."""
        ...


class DirectDatabaseReader:
    """In this process."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See Reader."""
        return read_if_changed(self._store, make, stamp)

    def close(self) -> None:
        """See Reader."""


class SubprocessDatabaseReader:
    """In a process of its own: a thread that reads would keep all answers waiting, row by row."""

    def __init__(self, url: str) -> None:
        """`url`: of the database."""
        self._url, self._aside = url, SubprocessRunner(1, NICE)

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See Reader. `make` is pickled. Raises ProblemError, too."""
        return self._aside.call(READ_S, _read_in_child, self._url, make, stamp)

    def close(self) -> None:
        """See Reader."""
        self._aside.close()


def read_if_changed(store: Store, make: Callable[[Session], _Made], stamp: str | None) -> tuple[str, _Made | None]:
    """See `Reader.look`."""
    with store.read() as session:
        now = audit.find_last(session, _IRRELEVANT_ACTIONS)
        return now, make(session) if now != stamp else None


@lru_cache(maxsize=1)
def _open_store(url: str) -> Store:
    return Store(url)


def _read_in_child(url: str, make: Callable[[Session], _Made], stamp: str | None) -> tuple[str, _Made | None]:
    return read_if_changed(_open_store(url), make, stamp)
