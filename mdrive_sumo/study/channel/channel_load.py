"""Channel busy ratio of a radio over the time of episodes (ETSI TS 102 687: share of time above -85 dBm)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.radio.radio_medium import BusyRatio

SPREAD_PERCENT = (5.0, 95.0)
"""Ends of the band that a picture shows: one station in twenty is below it, one above."""


class LoadOfSecond(NamedTuple):
    """Busy ratios in [0, 1] that stations measured in the same second of their episodes."""

    second: int
    measured: int
    mean: float
    low: float
    high: float
    highest: float


@dataclass
class ChannelLoads:
    """Busy ratios over recordings, by second since the start of the episode; empty unless the channel is a radio."""

    by_second: dict[int, list[float]] = field(default_factory=dict[int, list[float]])

    def add(self, measured: Iterable[BusyRatio]) -> None:
        """Add what the stations of a recording measured."""
        for tick, _, ratio in measured:
            self.by_second.setdefault(tick // TICKS_PER_SECOND, []).append(ratio)

    def list_seconds(self) -> list[LoadOfSecond]:
        """Return what was measured in each second, in order."""
        return [_summarise_second(second, ratios) for second, ratios in sorted(self.by_second.items())]

    def compute_mean(self) -> float | None:
        """Return the mean over all measurements; None without any."""
        ratios = [ratio for of_second in self.by_second.values() for ratio in of_second]
        return float(np.mean(ratios)) if ratios else None


def _summarise_second(second: int, ratios: Sequence[float]) -> LoadOfSecond:
    low, high = np.percentile(ratios, SPREAD_PERCENT).tolist()
    return LoadOfSecond(second, len(ratios), float(np.mean(ratios)), low, high, max(ratios))
