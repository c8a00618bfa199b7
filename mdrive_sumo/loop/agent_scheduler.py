"""Minds: the agents of an episode and their clock. Whom to ask, and in which tick an answer counts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.contract import Observation, Reply
from mdrive_sumo.core.clock import Clock
from mdrive_sumo.episode import ThinkTime
from mdrive_sumo.loop.agent_driver import AgentFailure, AgentDriver

Fail = Callable[[str, int, AgentFailure], None]


@dataclass(frozen=True, slots=True)
class _Answer:
    reply: Reply
    due: int


class AgentScheduler:
    """Asks every agent that is not thinking; while one thinks its CAV goes on with what it did last."""

    def __init__(self, drivers: Mapping[str, AgentDriver], clock: Clock, replayed: Sequence[ThinkTime], fail: Fail) -> None:
        """replayed: how long the agents of a recorded run thought; `fail` is told of every failure."""
        self._drivers, self._clock, self._fail = drivers, clock, fail
        self._replayed = {(one.ego, one.tick): one.ticks for one in replayed} if replayed else None
        self._pending: dict[str, _Answer] = {}
        self.thought: list[ThinkTime] = []
        """Every answer of a measured clock that took a tick or more."""

    def due(self, tick: int) -> dict[str, Reply]:
        """Answers to earlier questions that count from this tick on."""
        ready = [ego for ego, answer in self._pending.items() if answer.due <= tick]
        return {ego: self._pending.pop(ego).reply for ego in ready}

    def free(self, living: Iterable[str]) -> tuple[str, ...]:
        """Who is not thinking."""
        return tuple(ego for ego in living if ego not in self._pending)

    def ask(self, tick: int, seen: Mapping[str, Observation]) -> dict[str, Reply]:
        """Asks everyone who is named; the answers that count at once."""
        asked = [ego for ego, what in seen.items() if self._asked(ego, tick, what)]
        for ego in asked:
            reply = self._answer(ego, tick)
            if reply is not None:
                self._pending[ego] = _Answer(reply, tick + self._delay(ego, tick))
        return self.due(tick)

    def _delay(self, ego: str, tick: int) -> int:
        if self._clock.kind == "measured" and self._replayed is not None:
            ticks = self._replayed.get((ego, tick), 0)
        else:
            ticks = self._clock.delay(self._drivers[ego].thought_s)
        if self._clock.kind == "measured" and ticks:
            self.thought.append(ThinkTime(ego, tick, ticks))
        return ticks

    def _asked(self, ego: str, tick: int, seen: Observation) -> bool:
        try:
            self._drivers[ego].ask(seen)
        except AgentFailure as error:
            self._fail(ego, tick, error)
            return False
        return True

    def _answer(self, ego: str, tick: int) -> Reply | None:
        try:
            return self._drivers[ego].answer()
        except AgentFailure as error:
            self._fail(ego, tick, error)
            return None
