"""The wish that a process ends: said by a signal, or by the death of the one that started it."""

import os
import signal
from contextlib import suppress
from types import FrameType


class StopRequest:
    """Readable (`fd`) once it is wished; safe to say from a signal handler and from other threads."""

    def __init__(self) -> None:
        self.fd, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self.wished = False

    def wish(self) -> None:
        """From now on."""
        self.wished = True
        with suppress(BlockingIOError):
            os.write(self._writing, b".")

    def on_signals(self) -> None:
        """SIGTERM and SIGINT wish it."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def close(self) -> None:
        """Gives the pipe back."""
        os.close(self.fd)
        os.close(self._writing)

    def _on_signal(self, _: int, __: FrameType | None) -> None:
        self.wish()
