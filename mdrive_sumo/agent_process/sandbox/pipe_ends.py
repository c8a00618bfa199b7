"""Both ends of what connects a box with its evaluator, and the end of what the box printed."""

import os
import socket
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import fcntl
else:
    fcntl = import_posix("fcntl")

SOCKET_BUFFER = 4 << 20
"""Bytes; with the default a large observation waits for its reader several times."""


WIDE_LOG_BYTES = 1 << 20
"""What fits into the pipe of the output of a box of gVisor: most that a plain user may ask for (`pipe-max-size`)."""


@dataclass(frozen=True, slots=True)
class PipeEnds:
    """Descriptors made for one launch: ours stay open if it succeeds, theirs are closed in any case."""

    own: socket.socket
    log: int
    status: int
    """Reading ends, non-blocking."""
    agent: socket.socket
    log_writing: int
    status_writing: int
    nothing: int
    """Standard input."""
    theirs: ExitStack
    """Closes the box's ends here, once the box has them."""
    undo: ExitStack = field(default_factory=ExitStack)
    """Closes ours, if the launch fails."""

    @staticmethod
    def make() -> "PipeEnds":
        """A socketpair and two pipes."""
        own, agent = socket.socketpair()
        for end in (own, agent):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER)
        log, log_writing = os.pipe()
        status, status_writing = os.pipe()
        nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
        ends = PipeEnds(own, log, status, agent, log_writing, status_writing, nothing, ExitStack())
        for fd in (log, status):
            os.set_blocking(fd, False)
            ends.undo.callback(os.close, fd)
        for fd in (log_writing, status_writing, nothing):
            ends.theirs.callback(os.close, fd)
        ends.undo.enter_context(own)
        ends.theirs.enter_context(agent)
        return ends

    def widen_log(self) -> None:
        """Let the output wait for its reader for longer: in gVisor a write to a full pipe is an error and no wait."""
        with suppress(OSError):  # the user has too many pipes: it stays at 64 KiB
            fcntl.fcntl(self.log_writing, fcntl.F_SETPIPE_SZ, WIDE_LOG_BYTES)

    def in_memory(self, data: bytes) -> int:
        """Descriptor, closed with theirs, of a file without a name that stands at its beginning."""
        fd = os.memfd_create("mdrive-sumo", os.MFD_CLOEXEC)
        self.theirs.callback(os.close, fd)
        os.write(fd, data)
        os.lseek(fd, 0, os.SEEK_SET)
        return fd


AT_ONCE = 65536
MOST_PER_PUMP = 1 << 20
"""A flood must not hold its reader: what is left waits, and the writer with it."""


@dataclass(slots=True)
class LogRing:
    """Reads a pipe without waiting and keeps the last bytes, so that a flood of output costs no disk and no memory."""

    fd: int
    """Reading end of the pipe, non-blocking; owned."""
    keep_bytes: int
    seen_bytes: int = 0
    """Everything printed so far."""
    _end: bytearray = field(default_factory=bytearray)

    def pump(self) -> None:
        """Takes what has been printed since."""
        taken = 0
        while self.fd >= 0 and taken < MOST_PER_PUMP:
            try:
                piece = os.read(self.fd, AT_ONCE)
            except BlockingIOError:
                return
            if not piece:
                self.close()
            taken += len(piece)
            self.seen_bytes += len(piece)
            self._end += piece
            del self._end[: -self.keep_bytes]

    def text(self) -> bytes:
        """The last `keep_bytes` bytes."""
        return bytes(self._end)

    def close(self) -> None:
        """Gives up the pipe; what was kept stays."""
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1
