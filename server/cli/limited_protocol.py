"""The HTTP protocol of `serve`: limits of time and number of connections, of which uvicorn has none."""

import asyncio
import socket
from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar

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
SPARE = 4
"""A quarter more connections than stay are accepted until some are closed, if their headers have arrived."""
FIRST_WORD_S = 3
"""Time for which the kernel keeps a connection whose client says nothing [s]: two of its repetitions (1 s and 2 s)."""
ACCEPTED_AT_ONCE = 16
"""Connections that asyncio accepts before it does other work: 2 ms. Its default, the length of the queue, is 0.2 s."""
REFUSED_AT_ONCE = 64
"""Connections refused before other work is done: 1 ms."""
PROXIES = frozenset({"127.0.0.1", "::1"})
"""Addresses without a limit: behind a proxy of this machine, as docs/server.md describes it, all clients have these."""
HEADER_BYTES = 32 * 1024
"""Size limit of a request's headers [bytes]."""
_PEEK = int(socket.MSG_PEEK) | int(getattr(socket, "MSG_DONTWAIT", 0))  # Windows, which has no server, lacks it
OTHER_FILES = 256
"""Files that the server opens besides connections and what they are sent: database, uploads, pipes of children."""


class LimitedProtocol(H11Protocol):
    """Closes connections that wait for their client for too long, and those beyond `max_connections`."""

    max_connections: ClassVar[int] = 1000
    """Connections that stay; a quarter more are accepted, until `TRIM_S` later."""
    max_per_address: ClassVar[int] = 256
    """Connections of one address, `PROXIES` excepted."""
    origins: ClassVar[Counter[str]] = Counter()
    """Open connections by address."""
    is_trim_due: ClassVar[bool] = False
    held: ClassVar[set["LimitedProtocol"]] = set()
    """Open connections, without those that are being closed because there were too many."""
    _origin: str
    _timer: asyncio.TimerHandle
    _stall: asyncio.TimerHandle | None = None
    waiting_since_s: float = 0.0
    """Time of the connection or of the last response, by the clock of the event loop."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """asyncio's callback."""
        super().connection_made(transport)
        self._origin = name_origin(transport.get_extra_info("peername")[0])
        self.origins[self._origin] += 1
        self.held.add(self)
        self.waiting_since_s = float(self.loop.time())
        self._timer = self.loop.call_later(REQUEST_S, self._check_timeout, self.cycle)
        if len(self.held) > self.max_connections and not self.is_trim_due:
            type(self).is_trim_due = True
            self.loop.call_later(TRIM_S, self.trim)

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio's callback."""
        super().connection_lost(exc)
        self.held.discard(self)
        self.origins[self._origin] -= 1
        if not self.origins[self._origin]:
            del self.origins[self._origin]
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

    @classmethod
    def trim(cls) -> None:
        """Close the connections that have waited longest for their clients, as many as are too many."""
        cls.is_trim_due = False
        excess = max(0, len(cls.held) - cls.max_connections)
        waiting = [connection for connection in cls.held if connection.is_waiting()]
        for longest in sorted(waiting, key=_get_since)[:excess]:
            cls.held.discard(longest)
            longest.transport.abort()

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


def name_origin(address: str) -> str:
    """Return what counts as one address: of IPv6 the network of a customer (64 bits; RFC 6177)."""
    return socket.inet_pton(socket.AF_INET6, address)[:8].hex() if ":" in address else address


class LimitedListener(socket.socket):
    """A listening socket that refuses connections beyond the limits, before asyncio makes anything for them."""

    protocol: type[LimitedProtocol]

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection within the limits. Raises BlockingIOError if there is none, or to let others work."""
        for _ in range(REFUSED_AT_ONCE):
            connection, address = super().accept()
            if self._has_room(connection, address[0]):
                return connection, address
            connection.close()
        raise BlockingIOError

    def _has_room(self, connection: socket.socket, address: str) -> bool:
        protocol = self.protocol
        if address not in PROXIES and protocol.origins[name_origin(address)] >= protocol.max_per_address:
            return False
        if len(protocol.held) < protocol.max_connections:
            return True
        if not has_request(connection):
            return False
        most = protocol.max_connections + protocol.max_connections // SPARE
        if len(protocol.held) >= most:
            protocol.trim()
        return len(protocol.held) < most  # else all have work under way


def has_request(connection: socket.socket) -> bool:
    """Return whether the headers of a request have arrived."""
    try:
        return b"\r\n\r\n" in connection.recv(HEADER_BYTES, _PEEK)
    except OSError:  # nothing yet, or the client has left
        return False


def limit_connections(total: int, per_address: int) -> type[LimitedProtocol]:
    """Return the protocol of a server with at most so many connections at a time."""
    limits = {"max_connections": total, "max_per_address": per_address}
    return type(
        "LimitedProtocol", (LimitedProtocol,), limits | {"origins": Counter(), "held": set(), "is_trim_due": False}
    )


def limit_listener(listener: socket.socket, protocol: type[LimitedProtocol]) -> LimitedListener:
    """Return a listening socket, taken from `listener`, with the limits of `protocol`."""
    limited = LimitedListener(fileno=listener.detach())
    limited.protocol = protocol
    if hasattr(socket, "TCP_DEFER_ACCEPT"):  # Linux
        limited.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, FIRST_WORD_S)
    return limited


def raise_open_files(connections: int) -> int:
    """Let this process open enough files for so many connections, as far as its hard limit goes; return for how many.

    A response can hold a file, too.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 2 * connections + OTHER_FILES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        soft = wanted if hard == resource.RLIM_INFINITY else min(hard, wanted)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return connections if soft == resource.RLIM_INFINITY else (soft - OTHER_FILES) // 2
