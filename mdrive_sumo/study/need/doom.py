"""Which states of a CAV on its way to a conflict zone end in a collision for some start of the other road user."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT
from mdrive_sumo.study.need.approach import ApproachState, UserReaction
from mdrive_sumo.study.need.message_lead import Witnesses
from mdrive_sumo.study.need.occluders import BIN_TICKS
from mdrive_sumo.study.need.sight_tables import SightTables

RECENT_TICKS = 20
"""What was seen is most often seen in the last second, so that is looked at first."""


@dataclass(frozen=True)
class DoomTest:
    """Whether a state of the CAV lets some start of the other road user end in a collision."""

    tables: SightTables
    witnesses: Witnesses | None
    """The stations of which one must see the road user early enough; None: whether one does is not asked."""
    keeps_course: bool = False
    """Whether the road user brakes for no CAV although it is a vehicle: a scripted actor that avoids no collision."""

    @cached_property
    def reaction(self) -> UserReaction:
        """What the other road user can do."""
        return UserReaction(self.tables, self.keeps_course)

    @cached_property
    def _is_there_at_start(self) -> bool:
        """Whether the road user exists from the beginning, so that it waits at its start if it leaves later."""
        return self.tables.first_tick == 0

    @property
    def is_always_told(self) -> bool:
        """Whether no state can lack a witness."""
        return self.witnesses is None or self.witnesses.tells_of_itself

    @cached_property
    def steady_from(self) -> int:
        """The bin of time from which on all that a drive can have seen on its way stood after the recording."""
        return len(self.tables.set_of_bin) + self.tables.zone.leave // BIN_TICKS + 1

    def is_doomed(self, state: ApproachState, number: int) -> bool:
        """Return whether for every such state in a bin of time there is a start of the road user with these properties.

        The CAV could not see it in any tick before, wherever it may have been. After the state neither can avoid the
        other. And a station has seen it early enough, if `witnesses` are given.
        """
        ticks = self._list_candidates(state)
        ticks = ticks[~self._find_seen(state, number, ticks)] if len(ticks) else ticks
        return any(
            (self.witnesses is None or self.witnesses.see(number, tick)) and not self._can_react(state, number, tick)
            for tick in ticks.tolist()
        )

    def _list_candidates(self, state: ApproachState) -> Int:
        """Return the ticks of the road user's drive, at the last tick before the state, that lead to a collision."""
        zone = self.tables.zone
        first = zone.enter - math.ceil(state.clear_s / DT - 1e-9) + 1
        last = zone.leave - math.floor(state.enter_s / DT + 1e-9) - 2
        least = 0 if self._is_there_at_start else self.tables.first_tick + 1
        return np.arange(max(first, least), min(last, zone.leave) + 1)

    def _find_seen(self, state: ApproachState, number: int, ticks: Int) -> Bool:
        """Return (X,) whether the CAV may have seen the road user before."""
        latest = (number + 1) * BIN_TICKS - 1
        recent = np.arange(min(RECENT_TICKS, latest + 1))
        seen = self._find_seen_at(state, number, ticks, recent)
        if latest >= RECENT_TICKS and not seen.all():
            earlier = np.arange(RECENT_TICKS, latest + 1)
            seen[~seen] = self._find_seen_at(state, number, ticks[~seen], earlier)
        return seen

    def _find_seen_at(self, state: ApproachState, number: int, ticks: Int, lags: Int) -> Bool:
        """Return (X,) the same of some ticks (L,) before the state."""
        begin, end = self._find_past_stretches(state, lags, (number + 1) * BIN_TICKS - 1)
        times = ticks[:, None] - lags
        cells = self.tables.find_cells(times)
        exists = np.ones_like(times, dtype=np.bool_) if self._is_there_at_start else times >= self.tables.first_tick
        seen = np.zeros(len(ticks), dtype=np.bool_)
        sets = self._list_sets(number, lags)
        for number in np.unique(sets).tolist():
            chosen = (sets == number).any(axis=0)
            views = self.tables.sum_views_from_route(number)
            is_seen = views[end[chosen], cells[:, chosen]] > views[begin[chosen], cells[:, chosen]]
            seen |= (is_seen & exists[:, chosen]).any(axis=1)
        return seen

    def _find_past_stretches(self, state: ApproachState, lags: Int, latest: int) -> tuple[Int, Int]:
        back_m, front_m = state.compute_past(_to_seconds(lags))
        reach = self.tables.motion.compute_reach(_to_seconds(latest - lags + 1))
        return self.tables.find_stretches(back_m, np.minimum(front_m, reach))

    def _list_sets(self, number: int, lags: Int) -> Int:
        """Return (2, L) the sets of occluders at all times of a bin, so many ticks before."""
        ticks = np.stack((number * BIN_TICKS - lags, (number + 1) * BIN_TICKS - lags))
        return self.tables.set_of_bin[np.clip(ticks // BIN_TICKS, 0, len(self.tables.set_of_bin) - 1)]

    def _can_react(self, state: ApproachState, number: int, tick: int) -> bool:
        oldest = (number + 1) * BIN_TICKS - 1 if self._is_there_at_start else tick - self.tables.first_tick
        if not self.reaction.reacts:
            return False
        lags = np.arange(tick - self.tables.zone.leave, min(oldest, (number + 1) * BIN_TICKS - 1) + 1)
        return self.reaction.can_avoid(state, tick, lags, self._find_sight_of_ego(state, number, tick, lags))

    def _find_sight_of_ego(self, state: ApproachState, number: int, tick: int, lags: Int) -> Bool:
        """Return (L,) whether the road user may see the CAV so many ticks before the state (after it, if negative)."""
        before, after = lags[lags >= 0], lags[lags < 0]
        past = self._find_past_stretches(state, before, (number + 1) * BIN_TICKS - 1)
        future = self.tables.find_stretches(*state.compute_future(_to_seconds(-after)))
        begin, end = (np.concatenate(pair) for pair in zip(future, past, strict=True))
        rows = np.clip(tick - lags, self.tables.first_tick, self.tables.zone.leave) - self.tables.first_tick
        sees = np.zeros(len(lags), dtype=np.bool_)
        sets = self._list_sets(number, lags)
        for number in np.unique(sets).tolist():
            views = self.tables.sum_views_from_drive(number)
            sees |= (sets == number).any(axis=0) & (views[rows, end] > views[rows, begin])
        return sees


def _to_seconds(ticks: Int) -> Float:
    return ticks.astype(np.float64) * DT
