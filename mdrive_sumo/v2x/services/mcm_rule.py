"""When a station sends an MCM: on a change of what it intends or agrees to, and at 1 Hz at least.

ETSI's manoeuvre coordination service (TS 103 561) has no published generation rules yet: these are ours, in the manner
of those of CAMs.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.v2x.content import Mcm


@dataclass(frozen=True, slots=True)
class McmGeneration:
    """Parameters of `McmRule`; all are ours."""

    max_ticks: int = TICKS_PER_SECOND
    """At 1 Hz at least."""
    deviation_m: float = 1.0
    """[m] The plan has changed if the station is, or plans to be in `ahead_s`, further than this from where its last
    MCM has it: half the width of a car, beyond which receivers would plan around the wrong place."""
    ahead_s: float = 2.0
    """[s] Predictions of announcements count for about this long (`InterfaceParameters.trust_s`)."""
    validity_ticks: int = TICKS_PER_SECOND
    """Requests are announced anew when those that were announced end within this time: one MCM may be lost."""


MCM_GENERATION = McmGeneration()


class McmRule:
    """The MCMs of one station. Ask it in every planning step."""

    def __init__(self, parameters: McmGeneration = MCM_GENERATION) -> None:
        self._parameters = parameters
        self._last: tuple[int, Mcm] | None = None
        """Tick and content of the last MCM."""

    def check(self, tick: int, mcm: Mcm, dcc_ticks: int = 0) -> bool:
        """Return whether this MCM is to be sent in this tick; it then counts as sent.

        dcc_ticks: the least interval that congestion control grants.
        """
        if self._last is not None:
            sent_tick, before = self._last
            if tick - sent_tick < min(dcc_ticks, self._parameters.max_ticks):
                return False
            is_due = tick - sent_tick >= self._parameters.max_ticks or self._has_changed(tick, before, mcm)
            if not is_due:
                return False
        self._last = tick, mcm
        return True

    def _has_changed(self, tick: int, before: Mcm, now: Mcm) -> bool:
        have_terms_changed = (
            before.intention != now.intention
            or before.direction != now.direction
            or dict(before.requests) != dict(now.requests)
            or dict(before.answers) != dict(now.answers)
            or before.group != now.group
        )
        is_expiring = before.until_tick < now.until_tick and before.until_tick - tick <= self._parameters.validity_ticks
        return have_terms_changed or is_expiring or self._has_deviated(before, now)

    def _has_deviated(self, before: Mcm, now: Mcm) -> bool:
        elapsed_s = (now.pose.tick - before.pose.tick) * DT
        return any(
            portable.distance(_find_planned_place(before, elapsed_s + ahead_s), _find_planned_place(now, ahead_s))
            > self._parameters.deviation_m
            for ahead_s in (0.0, self._parameters.ahead_s)
        )


def _find_planned_place(mcm: Mcm, after_s: float) -> tuple[float, float]:
    """Return where [m] an MCM has its sender a time [s] after its pose: it stands after the end of what is planned."""
    points = np.vstack(((mcm.pose.x, mcm.pose.y), mcm.planned.reshape(-1, 2)))
    times = mcm.interval_s * np.arange(float(len(points)))
    x, y = (float(np.interp(after_s, times, points[:, axis])) for axis in range(2))
    return x, y
