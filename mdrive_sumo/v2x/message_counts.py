"""What results count of the messages of an episode: how many, what became of them, and rates by type."""

from collections import Counter
from collections.abc import Collection, Iterable
from typing import NamedTuple

from mdrive_sumo.core.state import DT
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import FLOOD
from mdrive_sumo.v2x.shared_reading import find_shared_problem

MAX_COUNTED_TYPES, OTHER = 32, "(other)"
"""Types of messages that results count one by one, and the name of all others, which no agent can use as a type."""
MAX_COUNTED_PROBLEMS = 8
"""Kinds of malformed messages that results count one by one."""


def count_exchanged(messages: Iterable[SentMessage], cavs: Collection[str]) -> dict[str, int]:
    """Return how many messages of a CAV reached at least one other CAV, by type; no message of a road-side unit counts.

    Nor do the useless bytes of a flood, which say nothing.

    Sorted by type; empty if the CAVs exchanged nothing. From the 33rd type on, all are counted together as `OTHER`.
    """
    arrived = (
        one.message.type
        for one in messages
        if one.message.sender in cavs
        and one.message.type != FLOOD
        and any(status is DeliveryStatus.DELIVERED for status, _ in one.deliveries.values())
    )
    counts: Counter[str] = Counter()
    for type_ in arrived:
        counts[type_ if type_ in counts or len(counts) < MAX_COUNTED_TYPES else OTHER] += 1
    return dict(sorted(counts.items()))


def count_malformed(messages: Iterable[SentMessage]) -> dict[str, int]:
    """Return how many messages were malformed, by type and what is wrong with them; empty if none was.

    Sorted, the most frequent first. From the 9th kind on, all are counted together as `OTHER`.
    """
    problems = (
        f"{one.message.type}: {(find_shared_problem(one.message) or '').partition(', found')[0]}"
        for one in messages
        if is_malformed(one)
    )
    counts: Counter[str] = Counter()
    for problem in problems:
        counts[problem if problem in counts or len(counts) < MAX_COUNTED_PROBLEMS else OTHER] += 1
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def is_malformed(sent: SentMessage) -> bool:
    """Return whether the channel has stopped a message because its bytes are not valid for its type."""
    first = next(iter(sent.deliveries.values()), None)  # of all receivers, or of none
    return first is not None and first.status is DeliveryStatus.MALFORMED


def count_bytes(messages: Iterable[SentMessage]) -> int:
    """Return the payload bytes of all messages that the channel takes: malformed ones are never transmitted."""
    return sum(len(one.message.payload) for one in messages if not is_malformed(one))


def count_deliveries(messages: Iterable[SentMessage]) -> dict[str, int]:
    """Return counts of sent messages ("sent"), payload bytes ("bytes") and receivers by delivery status.

    The bytes of malformed messages do not count. Statuses of a radio are left out where none has them. Empty if no
    message was sent.
    """
    sent = tuple(messages)
    if not sent:
        return {}
    deliveries = Counter(status for one in sent for status, _ in one.deliveries.values())
    totals = {"sent": len(sent), "bytes": count_bytes(sent)}
    counted = {
        status.value: deliveries[status] for status in DeliveryStatus if status not in _OF_RADIO or deliveries[status]
    }
    return totals | counted


_OF_RADIO = frozenset(tuple(DeliveryStatus)[tuple(DeliveryStatus).index(DeliveryStatus.EXPIRED) :])
"""Statuses that only a radio has: counts of other channels do not name them."""


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
