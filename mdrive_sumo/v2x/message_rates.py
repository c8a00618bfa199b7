"""How many messages and bytes all stations together send in a second, by type."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from mdrive_sumo.core.state import DT
from mdrive_sumo.v2x.channel import MAX_COUNTED_TYPES, OTHER, SentMessage, is_malformed


class MessageRate(NamedTuple):
    """What is sent of one type in a second, a message to many counting once."""

    messages_s: float
    """Messages in a second."""
    bytes_s: float
    """Payload bytes in a second, without headers."""


def compute_message_rates(messages: Iterable[SentMessage], ticks: int) -> dict[str, MessageRate]:
    """Return the rates of all stations together by type, sorted; ticks: over how many of them, above 0.

    Malformed messages, which the channel never transmits, do not count. From the 33rd type on, all are counted together
    as `OTHER`.
    """
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    for sent in messages:
        if is_malformed(sent):
            continue
        name = sent.message.type
        name = name if name in counts or len(counts) < MAX_COUNTED_TYPES else OTHER
        counts[name] += 1
        sizes[name] += len(sent.message.payload)
    seconds = ticks * DT
    return {name: MessageRate(counts[name] / seconds, sizes[name] / seconds) for name in sorted(counts)}
