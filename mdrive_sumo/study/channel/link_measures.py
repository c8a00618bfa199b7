"""How the links of a recording worked: what was received over distance, gaps between receptions, age of information.

Definitions: 3GPP TR 36.885, A.1.5 (packet reception ratio in rings of 20 m, packet inter-reception); age of
information: Kaul, Yates, Gruteser, "Real-time status: How often should one update?", INFOCOM 2012.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.v2x.channel import NOT_TRANSMITTED, DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import DENM, TEXT
from mdrive_sumo.v2x.radio.path_loss import LINK_NAMES

RING_M = 20.0
"""Width of a ring of distances (TR 36.885, A.1.5)."""
OF_EVENTS = frozenset({DENM, TEXT})
"""Types that are sent when something happens: the time between two of them says nothing about the channel."""
UNKNOWN_CLASS = "any"
"""Class of all links of a recording that has no link classes."""
Counts = npt.NDArray[np.int64]
"""(K,) how often each whole number from 0 to K - 1 was counted."""
NOTHING: Counts = np.zeros(0, dtype=np.int64)


class LinkGroup(NamedTuple):
    """What is counted together: links of a class, with messages of a type."""

    link_class: str
    """LOS, NLOSv or NLOSb, or `UNKNOWN_CLASS`."""
    message_type: str


class Ring(NamedTuple):
    """A group of links in a ring of distances."""

    group: LinkGroup
    number: int
    """The ring reaches from number x `RING_M` to the next one."""


@dataclass
class LinkCounts:
    """Counts over recordings, which add up."""

    transmitted: Counter[Ring] = field(default_factory=Counter[Ring])
    """Pairs of a transmitted message and a station that could have received it."""
    received: Counter[Ring] = field(default_factory=Counter[Ring])
    statuses: Counter[tuple[LinkGroup, str]] = field(default_factory=Counter[tuple[LinkGroup, str]])
    """Deliveries by status, those of messages that were not transmitted too."""
    gaps: dict[LinkGroup, Counts] = field(default_factory=dict[LinkGroup, Counts])
    """Number of gaps by their length [ticks]."""
    ages: dict[LinkGroup, Counts] = field(default_factory=dict[LinkGroup, Counts])
    """Number of ticks of pairs of stations by the age of the newest message [ticks]."""

    def add(self, record: EpisodeRecord, scenario: Scenario) -> None:
        """Add the links of a recording. scenario: has the places of its road-side units."""
        positions = _StationPositions(record, scenario)
        arrivals: dict[tuple[str, str, str], list[_Arrival]] = {}
        for sent in record.messages:
            for receiver, link_class in _list_receivers(sent):
                delivery = sent.deliveries[receiver]
                message = sent.message
                if not positions.fits(message.sender, receiver, (message.tick, delivery.tick)):
                    continue  # a recording may hold anything
                group = LinkGroup(link_class, message.type)
                self.statuses[group, delivery.status.value] += 1
                if delivery.status in NOT_TRANSMITTED or delivery.status is DeliveryStatus.GONE:
                    continue
                ring = Ring(group, int(positions.measure(message.sender, receiver, message.tick) // RING_M))
                self.transmitted[ring] += 1
                if delivery.status is DeliveryStatus.DELIVERED:
                    self.received[ring] += 1
                    if message.type in OF_EVENTS:
                        continue
                    pair = message.sender, receiver, message.type
                    arrivals.setdefault(pair, []).append(_Arrival(delivery.tick, message.tick, link_class))
        for (sender, receiver, message_type), received in arrivals.items():
            received.sort()
            self._add_gaps(message_type, received)
            until = min(positions.find_last_tick(sender), positions.find_last_tick(receiver))
            self._add_ages(message_type, received, until)

    def _add_gaps(self, message_type: str, received: "list[_Arrival]") -> None:
        """Add the gaps between receptions of a pair of stations; the class is that of the later one."""
        gaps = np.diff([arrival.tick for arrival in received])
        _add_by_class(self.gaps, message_type, gaps, [arrival.link_class for arrival in received[1:]])

    def _add_ages(self, message_type: str, received: "list[_Arrival]", until: int) -> None:
        """Add the age in every tick from the first reception until one of the stations ends."""
        ticks = np.arange(received[0].tick, until + 1)
        if not len(ticks):
            return
        arrivals = np.array([arrival.tick for arrival in received])
        newest = np.maximum.accumulate([arrival.sent_tick for arrival in received])
        latest = np.searchsorted(arrivals, ticks, side="right") - 1
        ages = ticks - newest[latest]
        classes = [arrival.link_class for arrival in received]
        _add_by_class(self.ages, message_type, ages, [classes[i] for i in latest.tolist()])


class _Arrival(NamedTuple):
    """A message that was received: in which tick, when it was sent, and over a link of which class."""

    tick: int
    sent_tick: int
    link_class: str


def _list_receivers(sent: SentMessage) -> Iterator[tuple[str, str]]:
    """Yield the receivers whose fate is known, with the class of their link."""
    for receiver in sent.deliveries:
        link = sent.links.get(receiver)
        yield receiver, UNKNOWN_CLASS if link is None else LINK_NAMES[link.link_class]


def list_link_classes(groups: Iterable[LinkGroup]) -> list[str]:
    """Return the classes of links that occur, the clearest first."""
    found = {group.link_class for group in groups}
    return [name for name in (UNKNOWN_CLASS, *LINK_NAMES.values()) if name in found]


def _add_by_class(
    target: dict[LinkGroup, Counts], message_type: str, values: Counts, link_classes: Sequence[str]
) -> None:
    """Count whole numbers from 0, each with its class of links."""
    of_value = np.array(link_classes)
    for link_class in sorted(set(link_classes)):
        group = LinkGroup(link_class, message_type)
        target[group] = add_counts(target.get(group, NOTHING), np.bincount(values[of_value == link_class]))


def add_counts(first: Counts, second: Counts) -> Counts:
    """Return the sum of counts by number from 0, as long as the longer one."""
    size = max(len(first), len(second))
    return np.pad(first, (0, size - len(first))) + np.pad(second, (0, size - len(second)))


class _StationPositions:
    """Where the stations of a recording are: CAVs and road-side units."""

    def __init__(self, record: EpisodeRecord, scenario: Scenario) -> None:
        self._last_tick = record.ticks - 1
        self._column = {ego: i for i, ego in enumerate(record.ego_ids)}
        self._xy = np.stack((record.x[:, : record.egos], record.y[:, : record.egos]), axis=-1)
        self._fixed: Mapping[str, tuple[float, float]] = {rsu.id: (rsu.x, rsu.y) for rsu in scenario.rsus}
        self._last = {ego: int(np.flatnonzero(record.valid[:, i])[-1]) for ego, i in self._column.items()}

    def _locate(self, station: str, tick: int) -> tuple[float, float]:
        if station in self._fixed:
            return self._fixed[station]
        x, y = self._xy[tick, self._column[station]].tolist()
        return x, y

    def fits(self, sender: str, receiver: str, ticks: tuple[int, int]) -> bool:
        """Return whether both stations are in the recording, and these ticks of sending and arrival can be."""
        are_known = all(station in self._column or station in self._fixed for station in (sender, receiver))
        return are_known and 0 <= ticks[0] <= ticks[1] <= self._last_tick

    def measure(self, sender: str, receiver: str, tick: int) -> float:
        """Return the distance [m] between two stations in a tick."""
        (x, y), (other_x, other_y) = self._locate(sender, tick), self._locate(receiver, tick)
        return portable.hypot(other_x - x, other_y - y)

    def find_last_tick(self, station: str) -> int:
        """Return the last tick in which a station is there."""
        return self._last.get(station, self._last_tick)
