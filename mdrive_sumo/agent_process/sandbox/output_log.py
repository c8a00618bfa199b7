"""The end of what a box printed."""

import os
from dataclasses import dataclass, field

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
