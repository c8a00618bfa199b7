"""Reads boards, and what is made of them, from the database: here, or in a process of its own."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from sqlalchemy.orm import Session

from server.api.subprocess_runner import ProcessAside
from server.store import Store, audit

LOOK_S = 30.0
"""Longest time for one look."""
NICE = 5
"""Of who makes boards: the old ones are handed out meanwhile."""
_ELSEWHERE = ("token-issued", "token-revoked", "team-created", "submission-accepted", "spot-check")
"""Deeds that change no board. Any other may, those too that there are not yet."""
_Made = TypeVar("_Made")


class Reader(Protocol):
    """Reads boards and what is made of them from a database, one at a time."""

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """The stamp of now, and unless it is that one, what `make` makes. Raises what it raises, StoreUnavailable."""
        ...

    def close(self) -> None:
        """Nothing is read any more."""
        ...


class ReaderHere:
    """In this process."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See Reader."""
        return looked(self._store, make, stamp)

    def close(self) -> None:
        """See Reader."""


class ReaderAside:
    """In a process of its own: a thread that reads would keep all answers waiting, row by row."""

    def __init__(self, url: str) -> None:
        """`url`: of the database."""
        self._url, self._aside = url, ProcessAside(1, NICE)

    def look(self, make: Callable[[Session], Any], stamp: str | None) -> tuple[str, Any]:
        """See Reader. `make` is pickled. Raises ProblemError, too."""
        return self._aside.call(LOOK_S, _looked_aside, self._url, make, stamp)

    def close(self) -> None:
        """See Reader."""
        self._aside.close()


def looked(store: Store, make: Callable[[Session], _Made], stamp: str | None) -> tuple[str, _Made | None]:
    """See `Reader.look`."""
    with store.read() as session:
        now = audit.last(session, _ELSEWHERE)
        return now, make(session) if now != stamp else None


@lru_cache(maxsize=1)
def _opened(url: str) -> Store:
    return Store(url)


def _looked_aside(url: str, make: Callable[[Session], _Made], stamp: str | None) -> tuple[str, _Made | None]:
    return looked(_opened(url), make, stamp)
