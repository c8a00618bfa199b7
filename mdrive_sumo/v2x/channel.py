"""Channel: messages on their way from one station to the others. docs/v2x.md says what it does and what it does not."""

import math
from collections import Counter, deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum, auto

from mdrive_sumo.contract import Message
from mdrive_sumo.core.seeding import UNIFORMS, draw_normals, draw_uniforms
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.comm_settings import CommSettings, LinkSettings
from mdrive_sumo.v2x.messages import displace_message, find_problem

Place = tuple[float, float]


class DeliveryStatus(StrEnum):
    """What became of a message for one receiver, or (the last four) for all of them."""

    DELIVERED = auto()
    LOST = auto()
    OUT_OF_RANGE = "out-of-range"
    GONE = auto()
    """The receiver ended before it arrived."""
    MUTED = auto()
    OVER_BUDGET = "over-budget"
    MALFORMED = auto()
    """Not readable as what its type says."""
    OFF = auto()
    """The channel is switched off."""


@dataclass(frozen=True, slots=True)
class SentMessage:
    """A message as it was sent, and what became of it."""

    message: Message
    deliveries: Mapping[str, tuple[DeliveryStatus, int]]
    """Receiver -> (fate, tick of arrival or of the loss)."""


@dataclass(frozen=True, slots=True)
class _Flight:
    """A message on its way to some receivers, who will all get it in the same tick."""

    message: Message
    n: int
    """Its place among what the sender said in that tick."""
    receivers: list[str]
    deliveries: dict[str, tuple[DeliveryStatus, int]]


class Channel:
    """One channel of one episode. Deterministic: what happens to a message depends on names and ticks only."""

    def __init__(self, comm: CommSettings, seed: int) -> None:
        self._comm, self._seed = comm, seed
        self._muted = comm.mute_filter
        self._drawn: dict[tuple[str, str, int], tuple[int, tuple[float, ...]]] = {}
        """(sender, receiver, n) -> the latest block of ticks and its numbers: a cache, nothing depends on it."""
        self._budgets: dict[str, _Budget] = {}
        self._flights: dict[int, list[_Flight]] = {}
        self._log: list[tuple[Message, dict[str, tuple[DeliveryStatus, int]]]] = []

    def send(
        self,
        tick: int,
        said: Mapping[str, tuple[Message, ...]],
        places: Mapping[str, Place],
        receivers: Collection[str] | None = None,
    ) -> None:
        """What stations say in this tick. To be called at most once a tick, after that tick's `deliver`.

        places: [m] of all senders and receivers. receivers: who can hear; None: everyone who has a place. Road-side
        units send only, so they have a place but are no receivers. Nobody hears oneself.
        """
        hearing = sorted(places if receivers is None else receivers)
        for sender in sorted(said):
            others = {one: math.dist(places[sender], places[one]) for one in hearing if one != sender}
            for n, unsigned in enumerate(said[sender]):
                message = Message(unsigned.type, unsigned.payload, sender, tick)
                deliveries: dict[str, tuple[DeliveryStatus, int]] = {}
                self._log.append((message, deliveries))
                stopped = self._stopped(message)
                if stopped is not None:
                    deliveries.update(dict.fromkeys(others, (stopped, tick)))
                else:
                    self._start(message, n, others, deliveries)

    def _stopped(self, message: Message) -> DeliveryStatus | None:
        """Why a message reaches nobody; None if it goes on its way."""
        comm = self._comm
        if not comm.on:
            return DeliveryStatus.OFF
        if find_problem(message) is not None:
            return DeliveryStatus.MALFORMED
        if self._muted and self._muted.matches(message.sender, message.type, message.tick):
            return DeliveryStatus.MUTED
        if math.isinf(comm.budget_bytes_s):
            return None
        budget = self._budgets.setdefault(message.sender, _Budget(comm.budget_bytes_s))
        fits = budget.take(message.tick, len(message.payload) + comm.header_bytes)
        return None if fits else DeliveryStatus.OVER_BUDGET

    def _start(
        self, message: Message, n: int, others: Mapping[str, float], deliveries: dict[str, tuple[DeliveryStatus, int]]
    ) -> None:
        """Sends a message, the n-th of its sender in this tick, to the others, who are so far away [m]."""
        link = self._comm.find_link(message.type)
        reached = list(others)
        if link.loss or not math.isinf(link.range_m):
            lost, beyond = (DeliveryStatus.LOST, message.tick), (DeliveryStatus.OUT_OF_RANGE, message.tick)
            for receiver, distance in others.items():
                if distance > link.range_m:
                    deliveries[receiver] = beyond
                elif link.loss and self._luck(message, n, receiver) < link.loss:
                    deliveries[receiver] = lost
            reached = [receiver for receiver in others if receiver not in deliveries]
        if reached:
            flight = _Flight(message, n, reached, deliveries)
            self._flights.setdefault(message.tick + max(link.latency_ticks, 1), []).append(flight)

    def _luck(self, message: Message, n: int, receiver: str) -> float:
        """In [0, 1), of that message for that receiver. Drawn for `UNIFORMS` ticks at once, for that is the cost."""
        pair = message.sender, receiver, n
        block, place = divmod(message.tick, UNIFORMS)
        drawn = self._drawn.get(pair)
        if drawn is None or drawn[0] != block:
            drawn = self._drawn[pair] = block, draw_uniforms(self._seed, "loss", *pair, block)
        return drawn[1][place]

    def deliver(self, tick: int, receivers: tuple[str, ...]) -> dict[str, tuple[Message, ...]]:
        """What reaches the living receivers in this tick, in the order of sending (then of senders' ids).

        To be called in every tick; receivers without a message are named too, with an empty tuple.
        """
        boxes: dict[str, list[Message]] = {receiver: [] for receiver in receivers}
        arrived, gone = (DeliveryStatus.DELIVERED, tick), (DeliveryStatus.GONE, tick)
        for flight in self._flights.pop(tick, ()):  # in the order of sending, for that is how they were put there
            link = self._comm.find_link(flight.message.type)
            wrong = link.pose_error_m or link.pose_error_deg
            for receiver in flight.receivers:
                if receiver not in boxes:
                    flight.deliveries[receiver] = gone
                    continue
                flight.deliveries[receiver] = arrived
                boxes[receiver].append(self._misplaced(link, flight, receiver) if wrong else flight.message)
        return {receiver: tuple(box) for receiver, box in boxes.items()}

    def _misplaced(self, link: LinkSettings, flight: _Flight, receiver: str) -> Message:
        """The message with an error of its sender's pose, as this receiver gets it."""
        message = flight.message
        once = () if link.pose_error_per == "episode" else (message.tick, flight.n)
        dx, dy, dyaw = draw_normals(self._seed, "pose", message.sender, receiver, *once)[:3]
        return displace_message(
            message, dx * link.pose_error_m, dy * link.pose_error_m, dyaw * math.radians(link.pose_error_deg)
        )

    def sent_messages(self) -> tuple[SentMessage, ...]:
        """Everything that was sent, in order; messages still in flight have no fate for those receivers yet."""
        return tuple(SentMessage(message, dict(deliveries)) for message, deliveries in self._log)


class _Budget:
    """What one station has sent in the last second."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._sent: deque[tuple[int, int]] = deque()
        self._sum = 0

    def take(self, tick: int, size: int) -> bool:
        """Whether so many bytes [B] may be sent now; if so, they are counted."""
        while self._sent and self._sent[0][0] <= tick - TICKS_PER_SECOND:
            self._sum -= self._sent.popleft()[1]
        if self._sum + size > self._limit:
            return False
        self._sent.append((tick, size))
        self._sum += size
        return True


def count_deliveries(messages: Iterable[SentMessage]) -> dict[str, int]:
    """Messages ("sent") and payload bytes ("bytes") that were handed to the channel, and for every fate how many
    receivers met it. Empty if nothing was said."""
    sent = tuple(messages)
    if not sent:
        return {}
    deliveries = Counter(fate for one in sent for fate, _ in one.deliveries.values())
    size = sum(len(one.message.payload) for one in sent)
    return {"sent": len(sent), "bytes": size} | {fate.value: deliveries[fate] for fate in DeliveryStatus}
