"""How much of something may be under way at the same time, for one and the same team."""

from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from http import HTTPStatus

from server.api.problems import ProblemError


class ConcurrencyLimit:
    """What is under way, by team, or by whoever else it is; for one event loop."""

    def __init__(self, what: str, most: int) -> None:
        """what: one of it, for the sentence; most: of one team."""
        self._what, self._most = what, most
        self._of: Counter[str] = Counter()

    @contextmanager
    def another(self, of: str) -> Generator[None]:
        """While it is under way. Raises ProblemError where too many are already."""
        if self._of[of] >= self._most:
            sentence = f"{self._what}: expected at most {self._most} of a team at a time, found another one"
            raise ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "over-limit", sentence, {"Retry-After": "60"})
        self._of[of] += 1
        try:
            yield
        finally:
            self._of[of] -= 1
            if not self._of[of]:
                del self._of[of]
