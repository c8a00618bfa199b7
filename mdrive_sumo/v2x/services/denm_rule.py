"""When a station sends DENMs: an event, its repetitions and its end (ETSI EN 302 637-3 V1.3.1).

Left out: negation by another station, forwarding of what was received (keep-alive), and relevance areas.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.content import Denm, EventCause, ReferencePose, Termination
from mdrive_sumo.v2x.denm_encoding import LAST_SEQUENCE


@dataclass(frozen=True, slots=True)
class Hazard:
    """A hazard that a station detects now: at most one of each cause."""

    cause: EventCause
    sub_cause: int
    """Sub cause code of ETSI TS 102 894-2."""
    x: float
    """Where it is, in the world frame [m]."""
    y: float


@dataclass(frozen=True, slots=True)
class Repetition:
    """How often a DENM is repeated, and how long receivers believe the last one. Both are ours.

    EN 302 637-3 leaves them to the application.
    """

    interval_ticks: int
    validity_s: float
    """[s] Longer than three intervals: of three repetitions one arrives."""


REPETITIONS: Mapping[EventCause, Repetition] = MappingProxyType(
    {
        # It stays for long; who comes near has some seconds to learn of it.
        EventCause.STATIONARY_VEHICLE: Repetition(TICKS_PER_SECOND, 4.0),
        # The follower has a second to react: as often as the fastest CAM.
        EventCause.DANGEROUS_SITUATION: Repetition(TICKS_PER_SECOND // 10, 1.0),
        EventCause.COLLISION_RISK: Repetition(TICKS_PER_SECOND // 10, 1.0),
    }
)
CANCELLATIONS = 3
"""A cancellation is sent so often: of three one arrives. Ours."""


class SenderFacts(NamedTuple):
    """The sender at the time of a DENM: its pose, its speed [m/s] and its size [m]."""

    pose: ReferencePose
    speed: float
    length: float
    width: float


@dataclass(slots=True)
class _Event:
    """An event that the station tells of."""

    sequence: int
    hazard: Hazard
    detection_tick: int
    due_tick: int
    cancellations: int = 0
    """How many cancellations have been sent; 0 while the event lasts."""
    is_over: bool = False


class DenmRule:
    """The DENMs of one station."""

    def __init__(self, repetitions: Mapping[EventCause, Repetition] = REPETITIONS) -> None:
        self._repetitions = repetitions
        self._events: dict[EventCause, _Event] = {}
        self._next_sequence = 0

    def check(self, tick: int, sender: SenderFacts, hazards: Sequence[Hazard]) -> list[Denm]:
        """Return the DENMs that are to be sent in this tick, which then count as sent, by cause code.

        A hazard that was not there in the last call is a new event, also while an earlier one of its cause is being
        cancelled; one that is there no more is cancelled. Repetitions have the present place and motion.
        """
        present = {hazard.cause: hazard for hazard in hazards}
        for cause, hazard in present.items():
            event = self._events.get(cause)
            if event is None or event.is_over:
                self._events[cause] = _Event(self._next_sequence, hazard, tick, tick)
                self._next_sequence = (self._next_sequence + 1) % (LAST_SEQUENCE + 1)
            else:
                event.hazard = hazard
        for cause, event in self._events.items():
            if cause not in present and not event.is_over:
                event.is_over, event.due_tick = True, tick
        due = [event for _, event in sorted(self._events.items()) if event.due_tick <= tick]
        denms = [self._send(tick, sender, event) for event in due]
        self._events = {cause: event for cause, event in self._events.items() if event.cancellations < CANCELLATIONS}
        return denms

    def _send(self, tick: int, sender: SenderFacts, event: _Event) -> Denm:
        repetition = self._repetitions[event.hazard.cause]
        event.due_tick = tick + repetition.interval_ticks
        event.cancellations += event.is_over
        return Denm(
            pose=sender.pose,
            sequence=event.sequence,
            cause=event.hazard.cause,
            sub_cause=event.hazard.sub_cause,
            x=event.hazard.x,
            y=event.hazard.y,
            detection_tick=event.detection_tick,
            validity_s=repetition.validity_s,
            speed=sender.speed,
            length=sender.length,
            width=sender.width,
            termination=Termination.CANCELLATION if event.is_over else Termination.NONE,
        )
