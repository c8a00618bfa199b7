"""The HTTP protocol of `serve`: limits of time and number of connections, of which uvicorn has none."""

import asyncio
from typing import TYPE_CHECKING, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from mdrive_sumo.core.posix import import_posix
from server.api.upload import UPLOAD_S, is_upload_under_way

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")

REQUEST_S = 20.0
"""Time from the connection, or the last response, to the end of the next request's headers [s]."""
READ_S = 60.0
"""Time in which a client that reads slowly must take what the kernel and asyncio hold for it, some 100 kB [s]."""
TRIM_S = 0.1
"""Time from a connection too many until some are closed [s]: requests that have arrived are read by then."""
OTHER_FILES = 256
"""Files that the server opens besides connections and what they are sent: database, uploads, pipes of children."""


class LimitedProtocol(H11Protocol):
    """Closes connections that wait for their client for too long, and those beyond `max_connections`."""

    max_connections: ClassVar[int] = 1000
    """Connections that stay; up to twice as many are accepted, until `TRIM_S` later."""
    is_trim_due: ClassVar[bool] = False
    trimmed: ClassVar[int] = 0
    """Connections that are being closed because there were too many."""
    _is_trimmed: bool = False
    _timer: asyncio.TimerHandle
    _stall: asyncio.TimerHandle | None = None
    waiting_since_s: float = 0.0
    """Time of the connection or of the last response, by the clock of the event loop."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """asyncio's callback."""
        super().connection_made(transport)
        self.waiting_since_s = float(self.loop.time())
        self._timer = self.loop.call_later(REQUEST_S, self._check_timeout, self.cycle)
        if self._count_open() > 2 * self.max_connections:
            self._trim()
            if self._count_open() > 2 * self.max_connections:  # all have work under way
                transport.abort()
        elif self._count_open() > self.max_connections and not self.is_trim_due:
            type(self).is_trim_due = True
            self.loop.call_later(TRIM_S, self._trim)

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio's callback."""
        super().connection_lost(exc)
        if self._is_trimmed:
            type(self).trimmed -= 1
        self._timer.cancel()
        self.resume_writing()

    def on_response_complete(self) -> None:
        """uvicorn's callback."""
        answered, self.waiting_since_s = self.cycle, float(self.loop.time())
        super().on_response_complete()  # it may start the next request
        self._timer.cancel()
        # Answered before the whole body arrived: the rest is discarded, since most clients read the response only then.
        left_s = UPLOAD_S if self.conn.their_state is h11.SEND_BODY else REQUEST_S
        self._timer = self.loop.call_later(left_s, self._check_timeout, answered)

    def pause_writing(self) -> None:
        """asyncio's callback: the client does not read."""
        super().pause_writing()
        self._stall = self._stall or self.loop.call_later(READ_S, self.transport.abort)

    def resume_writing(self) -> None:
        """asyncio's callback: the client has read."""
        super().resume_writing()
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None

    def _check_timeout(self, answered: object) -> None:
        if self.cycle is answered and not self.transport.is_closing():
            self.transport.close()

    def _count_open(self) -> int:
        return len(self.connections) - self.trimmed

    def _trim(self) -> None:
        """Close the connections that have waited longest for their clients, as many as are too many."""
        type(self).is_trim_due = False
        excess = max(0, self._count_open() - self.max_connections)
        waiting = [one for one in self.connections if isinstance(one, LimitedProtocol) and one.is_waiting()]
        for longest in sorted(waiting, key=_get_since)[:excess]:
            longest.abort_trimmed()

    def abort_trimmed(self) -> None:
        """Close this connection, because there are too many."""
        self._is_trimmed = True
        type(self).trimmed += 1
        self.transport.abort()

    def is_waiting(self) -> bool:
        """Return whether the connection waits for a request of its client, archives that are received excepted.

        The body of a refused request is none: who has no token could keep all connections with such bodies.
        """
        if self.transport.is_closing():
            return False
        if self.conn.their_state is h11.SEND_BODY:
            return not is_upload_under_way(self.scope.get("state", {}))
        return self.conn.their_state is h11.IDLE


def _get_since(connection: LimitedProtocol) -> float:
    return connection.waiting_since_s


def limit_connections(total: int) -> type[LimitedProtocol]:
    """Return the protocol of a server with at most `total` connections at a time."""
    return type("LimitedProtocol", (LimitedProtocol,), {"max_connections": total, "is_trim_due": False, "trimmed": 0})


def raise_open_files(connections: int) -> int:
    """Let this process open enough files for so many connections, as far as its hard limit goes; return for how many.

    A response can hold a file, too, and for `TRIM_S` there can be twice as many.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 2 * connections + OTHER_FILES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        soft = wanted if hard == resource.RLIM_INFINITY else min(hard, wanted)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return connections if soft == resource.RLIM_INFINITY else (soft - OTHER_FILES) // 2
