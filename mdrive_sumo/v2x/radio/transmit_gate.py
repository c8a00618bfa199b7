"""TransmitGate: congestion control between the queue of a station and the air (DCC of ETSI TS 102 687)."""

from mdrive_sumo.v2x.services.dcc import AdaptiveDcc

LEAST_GAP_S, LONGEST_GAP_S = 0.025, 1.0
"""TS 102 687 V1.2.1, annex B: bounds of the time between two packets of a station."""


class TransmitGate:
    """Congestion control of one station: packets of T seconds begin T / delta apart, delta the air time it may use."""

    def __init__(self) -> None:
        self._dcc = AdaptiveDcc()
        self._last_ratio = 0.0
        self._delta = self._dcc.delta

    def update(self, tick: int, busy_ratio: float) -> None:
        """Take the busy ratio in [0, 1] that the station measured, 200 ms after the one before."""
        self._dcc.update(tick, busy_ratio, self._last_ratio)
        self._delta = self._dcc.delta
        self._last_ratio = busy_ratio

    def find_opening(self, end_s: float, airtime_s: float) -> float:
        """Return the time [s] from which the next packet may go, after one of `airtime_s` that began before `end_s`."""
        gap_s = airtime_s / self._delta
        gap_s = LEAST_GAP_S if gap_s < LEAST_GAP_S else LONGEST_GAP_S if gap_s > LONGEST_GAP_S else gap_s
        return end_s - airtime_s + gap_s
