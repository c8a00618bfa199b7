"""Limit of simultaneous operations of one team, and of all teams together."""

from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from http import HTTPStatus

from server.api.problems import ProblemError

RETRY_S = 30
"""Retry-After where the limit of all teams is reached [s]."""


class ConcurrencyLimit:
    """Counts running operations by key (usually the team's id). Belongs to one event loop.

    A key that has operations running gets another one only while it has fewer than there are free places. So a key that
    takes all it can gets half of what it finds free, and the last place goes to a key without any operation: dynamic
    thresholds with alpha = 1 (Choudhury and Hahne, IEEE/ACM Transactions on Networking 6(2), 1998).
    """

    def __init__(self, operation: str, limit: int, total: int) -> None:
        """Set the limit per key and that of all keys; `operation` names one operation in the error message."""
        self._operation, self._limit, self._total = operation, limit, total
        self._running: Counter[str] = Counter()

    @property
    def running(self) -> int:
        """Running operations of all keys."""
        return self._running.total()

    @contextmanager
    def acquire(self, key: str) -> Generator[None]:
        """Count one operation of `key` during the block.

        Raises ProblemError: 429 at the limit of the key, 503 where too few places are left of all.
        """
        self._check(key)
        self._running[key] += 1
        try:
            yield
        finally:
            self._running[key] -= 1
            if not self._running[key]:
                del self._running[key]

    def _check(self, key: str) -> None:
        used, free = self._running[key], self._total - self._running.total()
        if used >= self._limit:
            sentence = f"{self._operation}: expected at most {self._limit} of a team at a time, found another one"
            raise ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "over-limit", sentence, {"Retry-After": "60"})
        if free <= 0 or 0 < used >= free:
            sentence = f"{self._operation}: too many of all teams at a time (at most {self._total}); try again later"
            raise ProblemError(HTTPStatus.SERVICE_UNAVAILABLE, "busy", sentence, {"Retry-After": str(RETRY_S)})
