"""V2X channel: delivery of messages between stations. docs/v2x.md describes its model and its limits."""

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum, auto
from typing import NamedTuple

from mdrive_sumo.contract import Message
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.seeding import UNIFORMS, derive_seed, draw_normals, draw_uniforms
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.comm_settings import CommSettings, LinkSettings
from mdrive_sumo.v2x.encoding import decode_pose
from mdrive_sumo.v2x.messages import FEATURE, FLOOD, displace_message
from mdrive_sumo.v2x.radio.path_loss import RadioEnvironment
from mdrive_sumo.v2x.radio.radio_medium import AirLink, BusyRatio, RadioLoss, RadioMedium, Transmission
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.shared_reading import find_shared_problem

Position = tuple[float, float]
Lucks = tuple[tuple[float, ...], ...]
"""Random numbers in [0, 1) by tick of a block, then by receiver."""


class DeliveryStatus(StrEnum):
    """Delivery status of a message for one receiver, or (`MUTED` to `EXPIRED`) for all receivers."""

    DELIVERED = auto()
    LOST = auto()
    OUT_OF_RANGE = "out-of-range"
    GONE = auto()
    """The receiver ended before the message arrived."""
    MUTED = auto()
    OVER_BUDGET = "over-budget"
    MALFORMED = auto()
    """The payload is not valid for the type."""
    OFF = auto()
    """The channel is switched off."""
    EXPIRED = auto()
    """The radio did not get to send it in time."""
    LOST_PATH_LOSS = "lost-path-loss"
    """Too weak at the receiver, without interference."""
    LOST_BUSY_RECEIVER = "lost-busy-receiver"
    """The receiver was receiving another packet, which the sender did not hear."""
    LOST_HALF_DUPLEX = "lost-half-duplex"
    """The receiver was sending."""
    LOST_COLLISION = "lost-collision"
    """Spoiled by a packet of another station."""


_STATUSES = {loss: DeliveryStatus(loss) for loss in RadioLoss}
NOT_TRANSMITTED = frozenset(map(DeliveryStatus, ("muted", "over-budget", "malformed", "off", "expired")))
"""What becomes of messages that the sender's radio never transmits, alike for all receivers."""


class Delivery(NamedTuple):
    """What became of a message on its way to one receiver."""

    status: DeliveryStatus
    tick: int
    """Tick of its arrival or loss."""


@dataclass(frozen=True, slots=True)
class SentMessage:
    """A message as it was sent, and its deliveries by receiver."""

    message: Message
    deliveries: Mapping[str, Delivery]
    links: Mapping[str, AirLink] = field(default_factory=dict[str, AirLink])
    """The radio link to each receiver when it was sent; empty unless the channel is a radio."""


_Waiting = tuple[Message, int, dict[str, float], tuple[str, ...], dict[str, Delivery]]
"""A message for the radio: its index among those of its sender, distances [m] by receiver, the receivers, and what
becomes of it."""


class _Flight(NamedTuple):
    """A message in transit to some receivers, all of which get it in the same tick."""

    message: Message
    n: int
    """Index among the messages of the sender in that tick."""
    receivers: list[str]
    deliveries: dict[str, Delivery]


class Channel:
    """The channel of one episode. Deterministic: the delivery of a message depends on names and ticks only."""

    def __init__(self, comm: CommSettings, seed: int, environment: RadioEnvironment = RadioEnvironment.URBAN) -> None:
        """environment: of the map, for a radio."""
        self._comm, self._seed = comm, seed
        self._radio_seed = derive_seed(seed, "radio")
        self._radio = RadioMedium(comm.radio, environment, self._radio_seed) if comm.radio and comm.on else None
        self._muted = comm.mute_filter
        self._drawn: dict[tuple[int, str, int], tuple[int, tuple[str, ...], Lucks]] = {}
        """(seed, sender, n) -> the latest block of ticks, the receivers, and their random numbers; a pure cache."""
        self._budgets: dict[str, _Budget] = {}
        self._flights: dict[int, list[_Flight]] = {}
        self._sent: list[Message] = []
        self._deliveries: list[dict[str, Delivery]] = []
        self._is_on_air: list[bool] = []
        """For each sent message: what became of it, and whether a radio has it."""

    def send(
        self,
        tick: int,
        outgoing: Mapping[str, tuple[Message, ...]],
        positions: Mapping[str, Position],
        receivers: Collection[str] | None = None,
        scene: RadioScene | None = None,
    ) -> None:
        """Send the messages of this tick. Call it at most once per tick, after that tick's `deliver`.

        outgoing: messages by sender. positions: [m] of all senders and receivers. receivers: ids of the stations that
        receive; None: all with a position. Road-side units have a position but do not receive. No station receives its
        own messages. scene: of all with a position, for a radio; with the background if `is_background_due`.
        """
        receiver_ids = sorted(positions if receivers is None else receivers)
        waiting: list[_Waiting] = []
        for sender in sorted(outgoing):
            others = measure_distances(positions, sender, receiver_ids)
            names = tuple(others)
            for n, message in enumerate(sign_messages(outgoing[sender], sender, tick)):
                deliveries: dict[str, Delivery] = {}
                self._sent.append(message)
                self._deliveries.append(deliveries)
                stopped = self._find_drop_reason(message)
                self._is_on_air.append(stopped is None and self._radio is not None)
                if stopped is not None:
                    deliveries.update(dict.fromkeys(others, Delivery(stopped, tick)))
                elif self._radio is not None:
                    waiting.append((message, n, others, names, deliveries))
                else:
                    self._transmit(message, n, others, deliveries)
        if waiting:
            self._send_by_radio(tick, waiting, scene)

    def is_background_due(self, tick: int) -> bool:
        """Return whether a radio needs the connected background vehicles of this tick, to measure its load."""
        return self._radio is not None and self._radio.is_load_due(tick)

    def _send_by_radio(self, tick: int, waiting: list[_Waiting], scene: RadioScene | None) -> None:
        """Send the messages of a tick over the radio, and transmit what it does not lose."""
        if self._radio is None or scene is None:
            raise ValueError("channel: expected the scene of a radio")
        sent = [
            Transmission(
                message.sender,
                len(message.payload),
                receivers,
                self._draw_lucks(self._radio_seed, message, n, receivers),
                message.type != FLOOD,
            )
            for message, n, _, receivers, _ in waiting
        ]
        lost = {loss: Delivery(status, tick) for loss, status in _STATUSES.items()}
        receptions = self._radio.transmit(tick, scene, sent)
        for (message, n, others, receivers, deliveries), (arrival_s, losses) in zip(waiting, receptions, strict=True):
            if arrival_s == math.inf:
                deliveries.update(dict.fromkeys(receivers, Delivery(DeliveryStatus.EXPIRED, tick)))
                continue
            if losses:
                deliveries.update({name: lost[loss] for name, loss in losses.items()})
                others = {name: distance for name, distance in others.items() if name not in losses}
            self._transmit(message, n, others, deliveries, math.ceil(arrival_s * TICKS_PER_SECOND))

    def _find_drop_reason(self, message: Message) -> DeliveryStatus | None:
        """Return why a message reaches no receiver; None if it is transmitted."""
        comm = self._comm
        if not comm.on:
            return DeliveryStatus.OFF
        if find_shared_problem(message) is not None:
            return DeliveryStatus.MALFORMED
        if self._muted and self._muted.matches(message.sender, message.type, message.tick):
            return DeliveryStatus.MUTED
        if math.isinf(comm.budget_bytes_s):
            return None
        budget = self._budgets.get(message.sender)
        if budget is None:
            budget = self._budgets[message.sender] = _Budget(comm.budget_bytes_s)
        fits = budget.take(message.tick, len(message.payload) + comm.header_bytes)
        return None if fits else DeliveryStatus.OVER_BUDGET

    def _transmit(
        self, message: Message, n: int, others: dict[str, float], deliveries: dict[str, Delivery], earliest: int = 0
    ) -> None:
        """Transmit a message, the n-th of its sender in this tick; others: distances [m] by receiver.

        earliest: tick of the earliest delivery.
        """
        link = self._comm.find_link(message.type)
        if link.loss or link.range_m < math.inf:
            lucks = self._draw_lucks(self._seed, message, n, tuple(others)) if link.loss else ()
            reached = select_reached(message.tick, others, link.range_m, link.loss, lucks, deliveries)
        else:
            reached = list(others)
        if reached:
            flight = _Flight(message, n, reached, deliveries)
            due = max(message.tick + max(link.latency_ticks, 1), earliest)
            self._flights.setdefault(due, []).append(flight)

    def _draw_lucks(self, seed: int, message: Message, n: int, receivers: tuple[str, ...]) -> tuple[float, ...]:
        """Return the random numbers in [0, 1) of a message for its receivers; one hash each serves `UNIFORMS` ticks."""
        pair = seed, message.sender, n
        block, place = divmod(message.tick, UNIFORMS)
        drawn = self._drawn.get(pair)
        if drawn is None or drawn[0] != block or drawn[1] != receivers:
            drawn = self._drawn[pair] = block, receivers, draw_lucks(seed, message.sender, n, receivers, block)
        return drawn[2][place]

    def deliver(self, tick: int, receivers: tuple[str, ...]) -> dict[str, tuple[Message, ...]]:
        """Return the messages that reach the active receivers now, in the order of sending, then of sender ids.

        Those that were due in ticks without a call, as between the frames of open loop, arrive now. Receivers without a
        message get an empty tuple.
        """
        inboxes: dict[str, list[Message]] = {receiver: [] for receiver in receivers}
        arrived, gone = Delivery(DeliveryStatus.DELIVERED, tick), Delivery(DeliveryStatus.GONE, tick)
        for flight in self._pop_due(tick):
            link = self._comm.find_link(flight.message.type)
            if link.pose_error_m or link.pose_error_deg:
                received = [self._add_pose_error(link, flight, receiver) for receiver in flight.receivers]
            else:
                received = [flight.message] * len(flight.receivers)
            hand_over(flight.receivers, received, inboxes, flight.deliveries, arrived, gone)
        return {receiver: tuple(inbox) for receiver, inbox in inboxes.items()}

    def _pop_due(self, tick: int) -> list[_Flight]:
        """Take out the flights that end now or before, in the order of sending."""
        due = [self._flights.pop(end) for end in sorted(self._flights) if end <= tick]
        if len(due) == 1:  # flights of one tick are stored in the order of sending
            return due[0]
        return sorted(
            (one for flights in due for one in flights), key=lambda one: (one.message.tick, one.message.sender, one.n)
        )

    def _add_pose_error(self, link: LinkSettings, flight: _Flight, receiver: str) -> Message:
        """Return the message with the pose error that this receiver gets."""
        message = flight.message
        # All packets of a map have the error of the one pose that it was made at, whenever they are sent.
        shared = (FEATURE, decode_pose(message.payload).tick) if message.type == FEATURE else (message.tick, flight.n)
        once = () if link.pose_error_per == "episode" else shared
        dx, dy, dyaw = draw_normals(self._seed, "pose", message.sender, receiver, *once)[:3]
        return displace_message(
            message, dx * link.pose_error_m, dy * link.pose_error_m, dyaw * math.radians(link.pose_error_deg)
        )

    def sent_messages(self) -> tuple[SentMessage, ...]:
        """Return all sent messages in order; messages in transit have no status for their receivers yet."""
        links: Mapping[str, Mapping[str, AirLink]] = {}
        sent: list[SentMessage] = []
        tick = -1
        for message, deliveries, is_on_air in zip(self._sent, self._deliveries, self._is_on_air, strict=True):
            if is_on_air and message.tick != tick and self._radio is not None:
                tick, links = message.tick, self._radio.list_links(message.tick)
            own = links[message.sender] if is_on_air else {}
            over = {name: own[name] for name in deliveries} if is_on_air else {}
            sent.append(SentMessage(message, dict(deliveries), over))
        return tuple(sent)

    def list_busy_ratios(self) -> tuple[BusyRatio, ...]:
        """Return what every station of a radio measured, in order of ticks and names."""
        return self._radio.list_busy_ratios() if self._radio is not None else ()


@twin
def sign_messages(messages: tuple[Message, ...], sender: str, tick: int, /) -> list[Message]:
    """Return the messages with their sender and tick."""
    return [Message(message.type, message.payload, sender, tick) for message in messages]


@twin
def measure_distances(positions: Mapping[str, Position], sender: str, receivers: Sequence[str], /) -> dict[str, float]:
    """Return the distance [m] from the sender to each receiver but itself, in their order."""
    x, y = positions[sender]
    return {one: portable.hypot(positions[one][0] - x, positions[one][1] - y) for one in receivers if one != sender}


@twin
def draw_lucks(seed: int, sender: str, n: int, receivers: tuple[str, ...], block: int, /) -> Lucks:
    """Return random numbers in [0, 1) for each receiver of a sender's n-th message, in each tick of a block."""
    drawn = [draw_uniforms(seed, "loss", sender, receiver, n, block) for receiver in receivers]
    return tuple(tuple(numbers[tick] for numbers in drawn) for tick in range(UNIFORMS))


@twin
def select_reached(
    tick: int,
    others: dict[str, float],
    range_m: float,
    loss: float,
    lucks: tuple[float, ...],
    deliveries: dict[str, Delivery],
    /,
) -> list[str]:
    """Return the receivers that a message reaches, and add the others to its deliveries.

    others: distances [m] by receiver. loss: share of messages that are lost. lucks: random numbers in [0, 1) of the
    receivers, not read if the loss is 0.
    """
    reached: list[str] = []
    for i, (receiver, distance) in enumerate(others.items()):
        if distance > range_m:
            deliveries[receiver] = Delivery(DeliveryStatus.OUT_OF_RANGE, tick)
        elif loss and lucks[i] < loss:
            deliveries[receiver] = Delivery(DeliveryStatus.LOST, tick)
        else:
            reached.append(receiver)
    return reached


@twin
def hand_over(
    receivers: list[str],
    messages: list[Message],
    inboxes: dict[str, list[Message]],
    deliveries: dict[str, Delivery],
    arrived: Delivery,
    gone: Delivery,
    /,
) -> None:
    """Put the message of each receiver into its inbox, and what became of it among the deliveries."""
    for receiver, message in zip(receivers, messages, strict=True):
        inbox = inboxes.get(receiver)
        deliveries[receiver] = gone if inbox is None else arrived
        if inbox is not None:
            inbox.append(message)


class _Budget:
    """Sliding one-second byte budget of one station."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._sent: deque[tuple[int, int]] = deque()
        self._sum = 0

    def take(self, tick: int, size: int) -> bool:
        """Reserve `size` bytes and return True if they fit into the budget of the last second."""
        while self._sent and self._sent[0][0] <= tick - TICKS_PER_SECOND:
            self._sum -= self._sent.popleft()[1]
        if self._sum + size > self._limit:
            return False
        self._sent.append((tick, size))
        self._sum += size
        return True
