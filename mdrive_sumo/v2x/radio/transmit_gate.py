"""TransmitGate: what may hold a station's packets back before they go on air (DCC of ETSI TS 102 687)."""

from typing import Protocol


class TransmitGate(Protocol):
    """Congestion control of one station."""

    def update(self, busy_ratio: float) -> None:
        """Take the busy ratio in [0, 1] that the station measured in the last 200 ms."""
        ...

    def find_opening(self, end_s: float, airtime_s: float) -> float:
        """Return the time [s] from which the next packet may go, after one that ended at `end_s`."""
        ...


class OpenGate:
    """No congestion control."""

    def update(self, busy_ratio: float) -> None:
        """Do nothing."""

    def find_opening(self, end_s: float, airtime_s: float) -> float:  # noqa: ARG002 - as the protocol
        """Return the end of the packet before."""
        return end_s
