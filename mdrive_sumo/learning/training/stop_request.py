"""StopRequest: Ctrl-C ends a training between two steps, so that its checkpoint is whole."""

import signal
from types import TracebackType
from typing import Any, Self


class StopRequest:
    """Within the block the first Ctrl-C is a request, and the next one interrupts as usual."""

    def __init__(self) -> None:
        self.is_made = False
        self._before: Any = None

    def __enter__(self) -> Self:
        """Take over Ctrl-C."""
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Give Ctrl-C back."""
        signal.signal(signal.SIGINT, self._before)

    def _note(self, *_: object) -> None:
        self.is_made = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
