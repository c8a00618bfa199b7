"""DeferredInterrupt: Ctrl-C ends a training between two steps, so that its checkpoint is whole."""

import signal
import threading
from types import TracebackType
from typing import Any, Self


class DeferredInterrupt:
    """Within the block the first Ctrl-C is a request, and the next one interrupts as usual."""

    def __init__(self) -> None:
        self.is_due = False
        self._before: Any = None

    def __enter__(self) -> Self:
        """Take over Ctrl-C; only the main thread gets it."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Give Ctrl-C back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, *_: object) -> None:
        self.is_due = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
