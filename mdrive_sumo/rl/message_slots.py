"""MessageSlots: the latest message of each other CAV, as numbers for a policy."""

from collections.abc import Iterable

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core.state import TICKS_PER_SECOND

LEARNED = "learned"
"""Type of the messages of policies on the channel."""


class MessageSlots:
    """What one CAV has heard. A sender keeps the slot in which it was first heard; later senders find none left."""

    def __init__(self, senders: int, length: int) -> None:
        """length: bytes of a message; 0: nothing is said."""
        self._length = length
        self._row_by_sender: dict[str, int] = {}
        self._heard = np.zeros((senders if length else 0, 2 + length), dtype=np.float32)
        self._ticks = [0] * len(self._heard)

    def add(self, messages: Iterable[Message]) -> None:
        """Take what has arrived; messages of other types and lengths are not for policies."""
        for message in messages:
            if message.type != LEARNED or len(message.payload) != self._length:
                continue
            row = self._row_by_sender.setdefault(message.sender, len(self._row_by_sender))
            if row < len(self._heard):
                self._heard[row, 0] = 1.0
                self._heard[row, 2:] = np.frombuffer(message.payload, dtype=np.uint8) / 255.0
                self._ticks[row] = message.tick

    def write(self, tick: int, out: np.ndarray) -> None:
        """Write (senders * (2 + length),): whether one was heard, its age [s] up to 1, and its bytes from 0 to 1."""
        for row, sent in enumerate(self._ticks):
            self._heard[row, 1] = min((tick - sent) / TICKS_PER_SECOND, 1.0) if self._heard[row, 0] else 0.0
        out[:] = self._heard.reshape(-1)


def count_message_numbers(senders: int, length: int) -> int:
    """Return how many numbers `MessageSlots.write` writes."""
    return senders * (2 + length) if length else 0
