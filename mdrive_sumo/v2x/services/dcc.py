"""Decentralised congestion control: which share of the air time a station may use (ETSI TS 102 687 V1.2.1, 5.4).

Pure logic over measured channel busy ratios (CBR); what measures them is the radio channel.
"""

import math
from dataclasses import dataclass

from mdrive_sumo.core.state import DT, TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class DccParameters:
    """Parameters of the adaptive approach: TS 102 687 V1.2.1, table 3 and section 5.4."""

    alpha: float = 0.016
    """Weight of the past: the share of the difference that is forgotten in each update."""
    beta: float = 0.0012
    """Share of the distance from the target that each update adds."""
    target_cbr: float = 0.68
    """Channel busy ratio in [0, 1] that all stations together aim at."""
    min_delta: float = 0.0006
    """Least share of the air time of a station."""
    max_delta: float = 0.03
    """Greatest share."""
    max_gain: float = 0.0005
    """Most that an update adds, before the past is weighted."""
    min_gain: float = -0.00025
    """Least, which is negative."""
    interval_ticks: int = TICKS_PER_SECOND // 5
    """Updates are 200 ms apart."""
    min_gap_ticks: int = 1
    """Least time between two packets: 25 ms, here one tick."""
    max_gap_ticks: int = TICKS_PER_SECOND
    """Longest time that a station must wait: 1 s."""


DCC = DccParameters()


class AdaptiveDcc:
    """Congestion control of one station."""

    def __init__(self, parameters: DccParameters = DCC) -> None:
        self._parameters = parameters
        self._cbr = 0.0
        """Smoothed local channel busy ratio."""
        self._delta = parameters.max_delta
        self._updated_tick: int | None = None
        self._open_tick = 0

    @property
    def delta(self) -> float:
        """The share of the air time in [0, 1] that the station may use. It starts at the greatest: roads are empty."""
        return self._delta

    def update(self, tick: int, cbr: float, last_cbr: float) -> None:
        """Take measured channel busy ratios in [0, 1]: the last one, of 100 ms, and the one before it.

        Call it in every tick or less often: it updates at the interval of the standard.
        """
        parameters = self._parameters
        if self._updated_tick is not None and tick - self._updated_tick < parameters.interval_ticks:
            return
        self._updated_tick = tick
        self._cbr = 0.5 * self._cbr + 0.25 * (cbr + last_cbr)  # step 1 of 5.4
        offset = parameters.beta * (parameters.target_cbr - self._cbr)
        offset = min(offset, parameters.max_gain) if offset > 0.0 else max(offset, parameters.min_gain)
        delta = (1.0 - parameters.alpha) * self._delta + offset
        self._delta = min(max(delta, parameters.min_delta), parameters.max_delta)

    def count_gap_ticks(self, airtime_s: float) -> int:
        """Return the ticks that must pass after a packet of this air time [s] before the next one (annex B)."""
        parameters = self._parameters
        gap = math.ceil(airtime_s / self._delta / DT)
        return min(max(gap, parameters.min_gap_ticks), parameters.max_gap_ticks)

    def is_open(self, tick: int) -> bool:
        """Return whether the station may send in this tick."""
        return tick >= self._open_tick

    def record_packet(self, tick: int, airtime_s: float) -> None:
        """Take a packet that the station sends now, of this air time [s]."""
        self._open_tick = tick + self.count_gap_ticks(airtime_s)
