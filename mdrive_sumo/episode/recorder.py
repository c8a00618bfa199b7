"""Collects quantized frames, applied controls and notes tick by tick, and builds the `EpisodeRecord`."""

from collections.abc import Iterator, Mapping, Sequence
from hashlib import blake2b
from itertools import groupby
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import DRIVER, REASON, Control, Note, Plan
from mdrive_sumo.core.state import Contact, Frame, Kind
from mdrive_sumo.episode.episode import (
    Ending,
    EpisodeRecord,
    NoteRecord,
    PlanRecord,
    ReceivedMessages,
    SignalEntry,
    ThinkTimeEntry,
)
from mdrive_sumo.episode.quantization import pack_controls, pack_states, round_points
from mdrive_sumo.v2x.channel import SentMessage
from mdrive_sumo.v2x.radio.radio_medium import BusyRatio

MAX_KINDS = 32
"""Kinds of notes in an episode. The baselines use four."""
MAX_NOTES = 20_000
"""Notes in an episode: two in every tick of eight CAVs for a minute."""
MAX_CHARACTERS = 8 * 2**20
"""Characters in all notes of an episode; an exchange with a language model has a few thousand."""
REASONS_SHARE = 2
"""Notes of kind `REASON` may fill one half of both limits: an agent writes many, and others shall find room after them.
Chosen: one of eight CAVs has room for three new reasons a second during seven minutes."""
MAX_DRIVER_NOTES, MAX_DRIVER_NOTE = 1600, 2000
"""Notes of kind `DRIVER` and characters of each that always find room: without them a take cannot be repeated."""


class NoteLog:
    """Collects notes; those beyond a limit are counted and dropped. The same notes are kept in every run."""

    def __init__(self) -> None:
        self._records: list[NoteRecord] = []
        self._kinds: set[str] = set()
        self._characters = 0
        self._reasons, self._reason_characters = 0, 0
        self._driver_notes = 0
        self.dropped = 0
        """Notes that were not kept."""

    @property
    def records(self) -> tuple[NoteRecord, ...]:
        """The notes that were kept, in order."""
        return tuple(self._records)

    def add(self, tick: int, ego: str, notes: Sequence[Note]) -> None:
        """Add the notes of one CAV."""
        for note in notes:
            if self._is_kept_apart(note):
                self._driver_notes += 1
                self._records.append(NoteRecord(tick, ego, note))
            elif self._has_room(note):
                self._kinds.add(note.kind)
                self._characters += len(note.text)
                if note.kind == REASON:
                    self._reasons += 1
                    self._reason_characters += len(note.text)
                self._records.append(NoteRecord(tick, ego, note))
            else:
                self.dropped += 1

    def _is_kept_apart(self, note: Note) -> bool:
        return note.kind == DRIVER and len(note.text) <= MAX_DRIVER_NOTE and self._driver_notes < MAX_DRIVER_NOTES

    def _has_room(self, note: Note) -> bool:
        if note.kind == REASON and (
            self._reasons >= MAX_NOTES // REASONS_SHARE
            or self._reason_characters + len(note.text) > MAX_CHARACTERS // REASONS_SHARE
        ):
            return False
        return (
            len(self._records) - self._driver_notes < MAX_NOTES
            and self._characters + len(note.text) <= MAX_CHARACTERS
            and (note.kind in self._kinds or len(self._kinds) < MAX_KINDS)
        )


PLAN_EVERY_TICKS = 4
"""Plans are recorded at 5 Hz: they are for display; re-execution uses the log of controls."""
DIGEST_BYTES = 8
"""Bytes of the digest of each tick: 64 bits tell any two episodes of a run apart."""


class Recorder:
    """Builds an `EpisodeRecord`."""

    def __init__(
        self,
        scenario: str,
        about: Mapping[str, Any],
        dimensions: Mapping[str, tuple[float, float]],
        pseudonyms: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Begin an episode.

        dimensions: (length, width) [m] of the CAVs, in the order of the scenario file. pseudonyms: the ids by which
        agents know CAVs and road-side units, by id in the scenario.
        """
        self._scenario, self._about = scenario, about
        self._pseudonyms = {told: station for station, told in pseudonyms.items() if told != station}
        self._egos = tuple(dimensions)
        self._columns = {ego: i for i, ego in enumerate(self._egos)}
        self._constants: list[tuple[int, float, float]] = [(int(Kind.VEHICLE), *size) for size in dimensions.values()]
        self._present: tuple[tuple[str, ...], tuple[str, ...]] | None = None
        self._present_columns: npt.NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        self._rows: list[tuple[npt.NDArray[np.intp], bytes]] = []
        self._controls: list[bytes] = []
        self._plans: list[PlanRecord] = []
        self._contacts: list[tuple[int, Contact]] = []
        self._signals: list[SignalEntry] = []
        self._notes = NoteLog()
        self._last_signals: dict[str, str] = {}
        self._digests: list[bytes] = []
        self._chain = blake2b(digest_size=DIGEST_BYTES)
        self._names_digest_input = b""
        self._signals_digest_input = "[]"

    def note(self, tick: int, ego: str, notes: Sequence[Note]) -> None:
        """Record notes of an agent, within the limits of `NoteLog`.

        They are no part of the digest, because no behaviour depends on them.
        """
        self._notes.add(tick, ego, notes)

    def add(
        self, frame: Frame, controls: Mapping[str, Control], plans: Mapping[str, Plan], received: ReceivedMessages
    ) -> None:
        """Add one tick: a frame at recording resolution, received messages, and the controls applied after it."""
        states, applied = pack_states(frame), pack_controls(self._egos, controls)
        self._rows.append((self._find_columns(frame), states))
        self._controls.append(applied)
        if frame.tick % PLAN_EVERY_TICKS == 0:
            self._plans += [
                PlanRecord(frame.tick, ego, p.interval_s, round_points(p.points)) for ego, p in plans.items()
            ]
        self._contacts += [(frame.tick, contact) for contact in frame.contacts]
        self._add_signals(frame)
        self._add_digest(frame, states, applied, received)

    def _find_columns(self, frame: Frame) -> npt.NDArray[np.intp]:
        present = tuple(frame.egos), frame.actors.ids  # the same object in most ticks
        if present == self._present:
            return self._present_columns
        actors = frame.actors
        for i, actor in enumerate(actors.ids):
            if actor not in self._columns:
                self._columns[actor] = len(self._columns)
                self._constants.append((int(actors.kind[i]), float(actors.length[i]), float(actors.width[i])))
        self._present = present
        names = [*frame.egos, *actors.ids]
        self._present_columns = np.array([self._columns[name] for name in names], dtype=np.intp)
        self._names_digest_input = "\n".join(names).encode()
        return self._present_columns

    def _add_signals(self, frame: Frame) -> None:
        if frame.signals == self._last_signals:
            return
        for light, state in frame.signals.items():
            if self._last_signals.get(light) != state:
                self._signals.append(SignalEntry(frame.tick, light, state))
        self._last_signals = {**self._last_signals, **frame.signals}
        self._signals_digest_input = repr(sorted(frame.signals.items()))

    def _add_digest(self, frame: Frame, states: bytes, controls: bytes, received: ReceivedMessages) -> None:
        facts = f"({frame.tick}, {self._signals_digest_input}, {frame.contacts!r})".encode()
        messages = _iterate_message_bytes(received)
        self._chain.update(b"".join((self._names_digest_input, states, controls, facts, *messages)))
        self._digests.append(self._chain.digest())

    @property
    def digest(self) -> str:
        """Digest of all added ticks, hexadecimal; "" before the first one."""
        return self._digests[-1].hex() if self._digests else ""

    def finish(
        self,
        endings: Sequence[Ending],
        sent: Sequence[SentMessage] = (),
        thinking: Sequence[ThinkTimeEntry] = (),
        busy_ratios: Sequence[BusyRatio] = (),
    ) -> EpisodeRecord:
        """Return the record of all added ticks."""
        shape = (len(self._rows), len(self._columns))
        valid = np.zeros(shape, dtype=np.bool_)
        quanta = np.zeros((*shape, 4), dtype=np.int32)
        begin = 0
        for _, run in groupby(self._rows, key=lambda row: id(row[0])):  # ticks with the same road users
            columns, states = zip(*run, strict=True)
            ticks = slice(begin, begin + len(states))
            valid[ticks, columns[0]] = True
            quanta[ticks, columns[0]] = np.frombuffer(b"".join(states), dtype="<i4").reshape(len(states), -1, 4)
            begin += len(states)
        kind, length, width = zip(*self._constants, strict=True)
        return EpisodeRecord(
            scenario=self._scenario,
            about=self._about,
            ids=tuple(self._columns),
            egos=len(self._egos),
            kind=np.array(kind, dtype=np.uint8),
            length=np.array(length),
            width=np.array(width),
            valid=valid,
            quanta=quanta,
            controls=np.frombuffer(b"".join(self._controls), dtype="<i2").reshape(shape[0], len(self._egos), 3),
            plans=tuple(self._plans),
            contacts=tuple(self._contacts),
            signals=tuple(self._signals),
            endings=tuple(endings),
            digests=np.frombuffer(b"".join(self._digests), dtype=np.uint8).reshape(shape[0], DIGEST_BYTES),
            messages=tuple(sent),
            busy_ratios=tuple(busy_ratios),
            notes=self._notes.records,
            dropped_notes=self._notes.dropped,
            thinking=tuple(thinking),
            pseudonyms=self._pseudonyms,
        )


def _iterate_message_bytes(received: ReceivedMessages) -> Iterator[bytes]:
    """Yield the delivered messages in the form of the digest, as each receiver got them."""
    for receiver, messages in received.items():
        for m in messages:
            yield repr((receiver, m.sender, m.tick, m.type, len(m.payload))).encode()
            yield m.payload
