"""Agents and their clock: which agents are asked in a tick, and in which tick a reply takes effect."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.contract import Observation, Reply
from mdrive_sumo.core.clock import Clock
from mdrive_sumo.episode import ThinkTimeEntry
from mdrive_sumo.loop.agent_driver import AgentDriver, AgentFailure
from mdrive_sumo.loop.request_pace import RequestPace


@dataclass(frozen=True, slots=True)
class _PendingReply:
    reply: Reply
    due_tick: int


class AgentScheduler:
    """Sends observations to agents and holds their replies back until the think time has passed."""

    def __init__(
        self,
        drivers: Mapping[str, AgentDriver],
        clock: Clock,
        recorded: Sequence[ThinkTimeEntry],
        report_failure: Callable[[str, AgentFailure], None],
        pace: RequestPace | None = None,
    ) -> None:
        """`recorded`: think times of a recorded run, used under a measured clock instead of the measured ones.

        `pace`: when requests go out; None: as soon as the tick before is done.
        """
        self._pace = pace
        self._drivers, self._clock, self._report_failure = drivers, clock, report_failure
        self._recorded_ticks = {(one.ego, one.tick): one.ticks for one in recorded} if recorded else None
        self._pending: dict[str, _PendingReply] = {}
        self.think_times: list[ThinkTimeEntry] = []
        """All think times of one tick or more under a measured clock."""

    def find_busy(self, tick: int) -> set[str]:
        """Return the CAVs whose agent still thinks in `tick`: they get no observation, their last control holds."""
        return {ego for ego, pending in self._pending.items() if pending.due_tick > tick}

    def collect_replies(self, tick: int, observations: Mapping[str, Observation]) -> dict[str, Reply]:
        """Send the observations of `tick` to the agents; return the replies that take effect in `tick`.

        All requests are prepared, then sent together, then the first reply is awaited. Failures go to `report_failure`.
        """
        replies = self._pop_due(tick)
        prepared = [ego for ego, observation in observations.items() if self._prepare(ego, observation)]
        if self._pace is not None:
            self._pace.wait()
        for ego in [ego for ego in prepared if self._send(ego)]:
            reply = self._receive(ego)
            delay = 0 if reply is None else self._compute_delay(ego, tick)
            if reply is not None and delay:
                self._pending[ego] = _PendingReply(reply, tick + delay)
            elif reply is not None:
                replies[ego] = reply
        return replies

    def _pop_due(self, tick: int) -> dict[str, Reply]:
        due = [ego for ego, pending in self._pending.items() if pending.due_tick <= tick]
        return {ego: self._pending.pop(ego).reply for ego in due}

    def _compute_delay(self, ego: str, tick: int) -> int:
        if self._clock.kind != "measured":
            return self._clock.ticks
        if self._recorded_ticks is not None:
            ticks = self._recorded_ticks.get((ego, tick), 0)
        else:
            ticks = self._clock.delay_ticks(self._drivers[ego].think_time_s)
        if ticks:
            self.think_times.append(ThinkTimeEntry(ego, tick, ticks))
        return ticks

    def _prepare(self, ego: str, observation: Observation) -> bool:
        if self._clock.kind == "measured":
            _ = observation.objects  # computed now: it is no think time
        try:
            self._drivers[ego].ask(observation)
        except AgentFailure as error:
            self._report_failure(ego, error)
            return False
        return True

    def _send(self, ego: str) -> bool:
        try:
            self._drivers[ego].send()
        except AgentFailure as error:
            self._report_failure(ego, error)
            return False
        return True

    def _receive(self, ego: str) -> Reply | None:
        try:
            return self._drivers[ego].answer()
        except AgentFailure as error:
            self._report_failure(ego, error)
            return None
