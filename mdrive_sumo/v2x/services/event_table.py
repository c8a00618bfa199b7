"""The events that DENMs have told a station of: each until it is cancelled or its validity has run out."""

from collections.abc import Iterable
from typing import NamedTuple

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.content import DENM, Denm, EventCause, Termination
from mdrive_sumo.v2x.shared_reading import decode_shared, find_shared_problem

WARNING = "warning"
"""Kind of the notes of new events."""
MAX_EVENTS = 256
"""A station that has told of so many events is not believed in new ones: nothing detects a new one every second."""


class EventName(NamedTuple):
    """What names an event: its sender, and its number there (the action id of EN 302 637-3)."""

    sender: str
    sequence: int


class EventTable:
    """Keeps the latest DENM of every event."""

    def __init__(self) -> None:
        self._latest: dict[EventName, Denm] = {}
        self._known: dict[str, set[int]] = {}
        """Numbers of the events of each sender, also of those that are over."""

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store the DENMs among messages; return a note on each new event. Trackers report unreadable ones."""
        notes: list[Note] = []
        for message in messages:
            if message.type != DENM or find_shared_problem(message) is not None:
                continue
            denm = decode_shared(message)
            assert isinstance(denm, Denm), "expected a DENM"
            notes += self._store(message.sender, denm)
        return tuple(notes)

    def _store(self, sender: str, denm: Denm) -> tuple[Note, ...]:
        name, known = EventName(sender, denm.sequence), self._known.setdefault(sender, set())
        is_new = denm.sequence not in known
        if is_new and len(known) >= MAX_EVENTS:
            return ()
        known.add(denm.sequence)
        before = self._latest.get(name)
        if before is not None and before.pose.tick > denm.pose.tick:
            return ()
        if not is_new and before is None:  # it is over: only a late repetition can come
            return ()
        if denm.termination is not Termination.NONE:
            self._latest.pop(name, None)
            return ()
        self._latest[name] = denm
        words = denm.cause.name.lower().replace("_", " ")
        return (Note(WARNING, f"{words} of {sender} at ({denm.x:.1f}, {denm.y:.1f})"),) if is_new else ()

    def forget(self, sender: str) -> None:
        """Drop the events of a sender, as it is not believed any more; it may warn of them again."""
        self._latest = {name: denm for name, denm in self._latest.items() if name.sender != sender}
        self._known.pop(sender, None)

    def find_events(self, tick: int, cause: EventCause | None = None) -> dict[EventName, Denm]:
        """Return the events that are valid at that tick, of one cause or of all, sorted by name; forget old ones."""
        self._latest = {name: denm for name, denm in self._latest.items() if _is_valid(denm, tick)}
        return {
            name: self._latest[name]
            for name in sorted(self._latest)
            if cause is None or self._latest[name].cause is cause
        }


def _is_valid(denm: Denm, tick: int) -> bool:
    """Return whether an event is not over; one of the future is an error of its sender."""
    return 0 <= tick - denm.pose.tick <= denm.validity_s * TICKS_PER_SECOND
