"""A CAV's knowledge of all members from their MCMs: one common view, compensated for the age of the messages."""

from typing import TypeAlias

from mdrive_sumo.contract import Message
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.negotiation.announcement import predict_announced_member
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import MCM, Mcm, MessageError
from mdrive_sumo.v2x.shared_reading import decode_shared

MEMORY_TICKS = TICKS_PER_SECOND
"""A station that has been silent for longer is dropped."""
ETSI_MEMORY_TICKS = 2 * TICKS_PER_SECOND + TICKS_PER_SECOND // 4
"""The same under `--v2x-rate etsi`, where MCMs come once a second at least: one may be lost, and take 250 ms."""

PeerView: TypeAlias = tuple[tuple[str, bytes, int], ...]
"""All that predictions of members depend on: by station its name, the payload of its MCM and the age of that [ticks].
CAVs with equal views predict the same."""


class PeerTable:
    """The latest MCM of every station, the own one included.

    Every CAV sees itself as the others see it, by its last announcement: over a perfect channel all CAVs have the same
    view, and a rule applied to it gives the same result everywhere.
    """

    def __init__(self, memory_ticks: int = MEMORY_TICKS) -> None:
        """memory_ticks: a station that has been silent for longer is dropped."""
        self._memory_ticks = memory_ticks
        self._latest: dict[str, tuple[int, Mcm, bytes]] = {}
        """By station: tick of sending, content and payload."""

    def receive(self, message: Message) -> bool:
        """Store an MCM; return False if the message is no readable MCM."""
        if message.type != MCM:
            return False
        try:
            mcm = decode_shared(message)
        except MessageError:
            return False
        known = self._latest.get(message.sender)
        if isinstance(mcm, Mcm) and (known is None or message.tick >= known[0]):
            self._latest[message.sender] = message.tick, mcm, message.payload
        return True

    def forget(self, station: str) -> None:
        """Drop what a station announced, as it is not believed any more."""
        self._latest.pop(station, None)

    def _get_latest(self, tick: int) -> dict[str, tuple[int, Mcm, bytes]]:
        """Return the entries by station, sorted by station; drop stations that have been silent for too long."""
        self._latest = {name: entry for name, entry in self._latest.items() if tick - entry[0] <= self._memory_ticks}
        return {name: self._latest[name] for name in sorted(self._latest)}

    def get_latest_mcms(self, tick: int) -> dict[str, Mcm]:
        """Return the latest MCM by station, sorted by station, without stations that have been silent for too long."""
        return {name: mcm for name, (_, mcm, _) in self._get_latest(tick).items()}

    def get_latest_payloads(self, tick: int) -> dict[str, bytes]:
        """Return the payloads of `get_latest_mcms`."""
        return {name: payload for name, (_, _, payload) in self._get_latest(tick).items()}

    def get_view(self, tick: int) -> PeerView:
        """Return what is known at that tick, sorted by station."""
        return tuple(
            (name, payload, _compute_age(sent, mcm, tick))
            for name, (sent, mcm, payload) in self._get_latest(tick).items()
        )

    def predict_members(self, tick: int) -> tuple[NegotiationMember, ...]:
        """Return all members as they should be at that tick, sorted by station."""
        return predict_view(self.get_view(tick))


def predict_view(view: PeerView) -> tuple[NegotiationMember, ...]:
    """Return the members of a view."""
    return tuple(predict_announced_member(*announced) for announced in view)


def _compute_age(sent: int, mcm: Mcm, tick: int) -> int:
    """Return the ticks since the sender was at the position in its message; a slow agent sends late."""
    return max(tick - min(max(mcm.pose.tick, sent - MEMORY_TICKS), sent), 0)
