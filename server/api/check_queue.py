"""Turns of teams at the checkers of archives: fair by time, so that no team's uploads delay those of another."""

import asyncio
from collections import Counter
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from time import monotonic

HALF_LIFE_S = 600.0
"""Time after which a team's used checking time counts half [s]."""


@dataclass(frozen=True, slots=True)
class _WaitingCheck:
    team: str
    turn: asyncio.Future[None]


class CheckQueue:
    """Grants turns at `slots` checkers, at least two. Belongs to one event loop.

    The team that used the least checking time is next. One team never occupies all checkers, so another team waits at
    most for the check under way of each team that used less. The number of waiting uploads of a team is limited
    elsewhere (`settings.ConnectionSettings`).
    """

    def __init__(self, slots: int, clock: Callable[[], float] = monotonic) -> None:
        if slots < 2:
            raise ValueError(f"slots: expected at least 2, found {slots}")
        self._slots, self._clock = slots, clock
        self._running: Counter[str] = Counter()
        self._waiting: list[_WaitingCheck] = []
        self._used: dict[str, tuple[float, float]] = {}
        """Checking time [s] and when it was counted, by team."""

    @asynccontextmanager
    async def turn(self, team: str) -> AsyncGenerator[None]:
        """Wait for a checker; it is occupied during the block."""
        mine = _WaitingCheck(team, asyncio.get_running_loop().create_future())
        self._waiting.append(mine)
        self._grant()
        try:
            await mine.turn
        except asyncio.CancelledError:
            self._withdraw(mine)
            raise
        begun_s = self._clock()
        try:
            yield
        finally:
            self._charge(team, self._clock() - begun_s)
            self._release(team)

    def _grant(self) -> None:
        while self._running.total() < self._slots:
            able = [check for check in self._waiting if self._running[check.team] < self._slots - 1]
            if not able:
                return
            chosen = min(able, key=lambda check: self._recent_s(check.team))  # the first of equals: it came first
            self._waiting.remove(chosen)
            self._running[chosen.team] += 1
            chosen.turn.set_result(None)

    def _withdraw(self, mine: _WaitingCheck) -> None:
        """Forget a client that has left, also in the moment in which its turn came."""
        if mine in self._waiting:
            self._waiting.remove(mine)
        elif mine.turn.done() and not mine.turn.cancelled():
            self._release(mine.team)

    def _release(self, team: str) -> None:
        self._running[team] -= 1
        if not self._running[team]:
            del self._running[team]
        self._grant()

    def _charge(self, team: str, used_s: float) -> None:
        self._used[team] = (self._recent_s(team) + used_s, self._clock())
        if len(self._used) > 1000:  # of teams that have not come back
            self._used = {name: used for name, used in self._used.items() if self._recent_s(name) > 0.001}

    def _recent_s(self, team: str) -> float:
        used_s, at_s = self._used.get(team, (0.0, 0.0))
        return used_s * 0.5 ** ((self._clock() - at_s) / HALF_LIFE_S)
