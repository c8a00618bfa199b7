"""TakeActions: where the drivers of a take read what happens, live and in a re-execution alike: in its actions."""

from collections.abc import Sequence

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.runs.takes import HUMAN, Action, RecordedActions, make_leaving
from server.drive.worker.take_journal import TickActions


class EnteredRun:
    """The recorded run in which a drive begins: its actions are those of all ticks before the one that is entered."""

    def __init__(self, record: EpisodeRecord, tick: int, *, is_driven: bool) -> None:
        """is_driven: its agents drive again; else its replies are repeated as they are. Raises InputError."""
        self.tick, self.is_driven = tick, is_driven
        self._digests = record.digests
        is_take = record.about.get("agent") == HUMAN
        self._sources = {ego: RecordedActions(record, ego, is_entered=not is_take) for ego in record.ego_ids}

    def find_digest(self, tick: int) -> str:
        """Return the digest of all ticks before a tick, as `EpisodeSimulation.digest`."""
        return bytes(self._digests[tick - 1]).hex() if tick else ""

    def read(self, ego: str, tick: int) -> Action:
        """Return what happened in a CAV. Raises AgentFailure where its agent failed."""
        return self._sources[ego].read(tick)


class TakeLog:
    """The actions of a take by tick; the drivers of all its CAVs share it, and a branch replaces its content."""

    def __init__(self, entered: EnteredRun | None = None) -> None:
        self.ticks: list[TickActions] = []
        self.entered_tick = 0
        """The actions of all ticks before are those of the run that was entered."""
        self.entered = entered

    def replace(self, ticks: Sequence[TickActions], entered_tick: int) -> None:
        """Go on with these actions."""
        self.ticks, self.entered_tick = list(ticks), entered_tick

    def read(self, ego: str, tick: int) -> Action:
        """Return what happens in a CAV in a tick. Raises AgentFailure if its person leaves."""
        if self.entered is not None and not self.entered.is_driven and tick < self.entered_tick:
            return self.entered.read(ego, tick)
        actions = self.ticks[tick]
        if ego in actions.left:
            raise make_leaving(tick)
        one = actions.cavs.get(ego)
        return one.action if one is not None else Action()


class TakeActions:
    """An `ActionSource`: one CAV of a `TakeLog`."""

    def __init__(self, log: TakeLog, ego: str) -> None:
        self._log, self._ego = log, ego

    def read(self, tick: int) -> Action:
        """See ActionSource."""
        return self._log.read(self._ego, tick)
