"""What one sender claimed that the own sensor refutes, over time: a claim is a lie when it is refuted for long.

A detector has false positives of half a second, and an error of half a second (docs/detections.md), which an honest
sender passes on. What it says for longer, at one place or of one object, it takes for real.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from mdrive_sumo.core.state import TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class ClaimParameters:
    """Parameters of `ClaimHistory`."""

    lie_ticks: int = TICKS_PER_SECOND
    """A claim that is refuted from its first to its last time for so long is a lie: two epochs of a detector's errors,
    so that three in a row would have to stand at one place by chance."""
    gap_ticks: int = TICKS_PER_SECOND // 2
    """A refuted claim that is not refuted again within this time is forgotten: an epoch of a detector's errors."""
    same_m: float = 2.5
    """[m] Claims nearer than this are one, whatever they are called."""


CLAIMS = ClaimParameters()
ETSI_CLAIMS = replace(CLAIMS, lie_ticks=2 * TICKS_PER_SECOND, gap_ticks=TICKS_PER_SECOND + TICKS_PER_SECOND // 4)
"""Under `--v2x-rate etsi` a CPM tells of a standing object once a second: a lie is refuted three times in a row."""


class Claim(NamedTuple):
    """A box that a sender reports."""

    name: str
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class _Doubt:
    """A claim that was refuted in all updates from the first to the last one."""

    claim: Claim
    first_tick: int
    last_tick: int


class ClaimHistory:
    """The refuted claims of one sender."""

    def __init__(self, parameters: ClaimParameters = CLAIMS) -> None:
        self._parameters = parameters
        self._doubts: list[_Doubt] = []

    def update(self, tick: int, refuted: Iterable[Claim], supported: Iterable[str]) -> bool:
        """Add the claims of a tick; return whether one of them has been refuted for so long that it is a lie.

        supported: names of the claims that the own sensor confirms. A lie begins anew after it was told.
        """
        kept = {*supported}
        parameters = self._parameters
        doubts = [one for one in self._doubts if one.claim.name not in kept]
        doubts = [one for one in doubts if tick - one.last_tick <= parameters.gap_ticks]
        for claim in refuted:
            before = next((one for one in doubts if self._is_same(one.claim, claim)), None)
            if before is None:
                doubts.append(_Doubt(claim, tick, tick))
            else:
                doubts.remove(before)
                doubts.append(replace(before, claim=claim, last_tick=tick))
        self._doubts = [one for one in doubts if one.last_tick - one.first_tick < parameters.lie_ticks]
        return len(self._doubts) < len(doubts)

    def _is_same(self, a: Claim, b: Claim) -> bool:
        dx, dy = a.x - b.x, a.y - b.y
        return a.name == b.name or dx * dx + dy * dy < self._parameters.same_m * self._parameters.same_m
