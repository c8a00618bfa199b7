"""Request that a process ends: by a signal, or by the end of its parent."""

import os
import signal
from contextlib import suppress
from types import FrameType


class StopRequest:
    """Its `fd` becomes readable with the request; `request` is safe in signal handlers and other threads."""

    def __init__(self) -> None:
        self.fd, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self.is_requested = False

    def request(self) -> None:
        """Request the end."""
        self.is_requested = True
        with suppress(BlockingIOError):
            os.write(self._writing, b".")

    def install_signal_handlers(self) -> None:
        """Make SIGTERM and SIGINT request the end."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def close(self) -> None:
        """Close the pipe."""
        os.close(self.fd)
        os.close(self._writing)

    def _on_signal(self, _: int, __: FrameType | None) -> None:
        self.request()
