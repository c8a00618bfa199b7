"""Limit of simultaneous operations of one team."""

from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from http import HTTPStatus

from server.api.problems import ProblemError


class ConcurrencyLimit:
    """Counts running operations by key (usually the team's id). Belongs to one event loop."""

    def __init__(self, operation: str, limit: int) -> None:
        """Set the limit per key; `operation` names one operation in the error message."""
        self._operation, self._limit = operation, limit
        self._running: Counter[str] = Counter()

    @contextmanager
    def acquire(self, key: str) -> Generator[None]:
        """Count one operation of `key` during the block. Raises ProblemError (429) at the limit."""
        if self._running[key] >= self._limit:
            sentence = f"{self._operation}: expected at most {self._limit} of a team at a time, found another one"
            raise ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "over-limit", sentence, {"Retry-After": "60"})
        self._running[key] += 1
        try:
            yield
        finally:
            self._running[key] -= 1
            if not self._running[key]:
                del self._running[key]
