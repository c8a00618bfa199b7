"""Recorder: takes quantised frames and applied controls tick by tick, and makes the Episode."""

from collections.abc import Iterator, Mapping, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import CONTROL_STEP, Control, Note, Plan
from mdrive_sumo.core.state import Contact, EgoState, Frame, Kind
from mdrive_sumo.episode.episode import (
    Ending,
    EpisodeRecord,
    NoteRecord,
    PlanRecord,
    ReceivedMessages,
    SignalChange,
    ThinkTime,
)
from mdrive_sumo.episode.quantization import Quanta, to_quanta
from mdrive_sumo.v2x.channel import SentMessage

PLAN_EVERY_TICKS = 4
"""Plans are kept at 5 Hz: they are for looking at; what re-executes an episode is the log of controls."""
DIGEST_BYTES = 8


class Recorder:
    """The only writer of an Episode. `sizes` are (length, width) [m] of the CAVs, in the order of the scenario."""

    def __init__(self, scenario: str, about: Mapping[str, Any], sizes: Mapping[str, tuple[float, float]]) -> None:
        self._scenario, self._about = scenario, about
        self._egos = tuple(sizes)
        self._columns = {ego: i for i, ego in enumerate(self._egos)}
        self._facts: list[tuple[int, float, float]] = [(int(Kind.VEHICLE), *size) for size in sizes.values()]
        self._present: tuple[str, ...] | None = None
        self._present_columns: npt.NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        self._rows: list[tuple[npt.NDArray[np.intp], Quanta]] = []
        self._controls: list[npt.NDArray[np.int16]] = []
        self._plans: list[PlanRecord] = []
        self._contacts: list[tuple[int, Contact]] = []
        self._signals: list[SignalChange] = []
        self._notes: list[NoteRecord] = []
        self._shown: dict[str, str] = {}
        self._digests: list[bytes] = []
        self._chain = blake2b(digest_size=DIGEST_BYTES)
        self._names = b""

    def note(self, tick: int, ego: str, notes: Sequence[Note]) -> None:
        """What an agent wants to be kept; no part of the digest, for nobody's driving depends on it."""
        self._notes += [NoteRecord(tick, ego, note) for note in notes]

    def add(
        self, frame: Frame, controls: Mapping[str, Control], plans: Mapping[str, Plan], heard: ReceivedMessages
    ) -> None:
        """One tick: a frame at recording resolution, what reached the CAVs in it, and the controls applied after it."""
        quanta = to_quanta(self._table(frame))
        applied = np.zeros((len(self._egos), 3), dtype=np.int16)
        for ego, control in controls.items():
            applied[self._columns[ego]] = (
                round(control.throttle / CONTROL_STEP),
                round(control.brake / CONTROL_STEP),
                round(control.steer / CONTROL_STEP),
            )
        self._rows.append((self._columns_of(frame), quanta))
        self._controls.append(applied)
        if frame.tick % PLAN_EVERY_TICKS == 0:
            self._plans += [
                PlanRecord(frame.tick, ego, p.interval_s, np.round(p.points, 2)) for ego, p in plans.items()
            ]
        self._contacts += [(frame.tick, contact) for contact in frame.contacts]
        self._note_signals(frame)
        self._note_digest(frame, quanta, applied, heard)

    @staticmethod
    def _table(frame: Frame) -> npt.NDArray[np.float64]:
        actors = frame.actors
        table = np.empty((len(frame.egos) + len(actors), 4))
        for i, ego in enumerate(frame.egos.values()):
            table[i] = _row(ego)
        rest = table[len(frame.egos) :]
        rest[:, 0], rest[:, 1], rest[:, 2], rest[:, 3] = actors.x, actors.y, actors.yaw, actors.speed
        return table

    def _columns_of(self, frame: Frame) -> npt.NDArray[np.intp]:
        present = (*frame.egos, *frame.actors.ids)
        if present == self._present:
            return self._present_columns
        actors = frame.actors
        for i, actor in enumerate(actors.ids):
            if actor not in self._columns:
                self._columns[actor] = len(self._columns)
                self._facts.append((int(actors.kind[i]), float(actors.length[i]), float(actors.width[i])))
        self._present = present
        self._present_columns = np.array([self._columns[i] for i in present], dtype=np.intp)
        self._names = "\n".join(present).encode()
        return self._present_columns

    def _note_signals(self, frame: Frame) -> None:
        for light, state in frame.signals.items():
            if self._shown.get(light) != state:
                self._shown[light] = state
                self._signals.append(SignalChange(frame.tick, light, state))

    def _note_digest(
        self, frame: Frame, quanta: Quanta, applied: npt.NDArray[np.int16], heard: ReceivedMessages
    ) -> None:
        facts = repr((frame.tick, sorted(frame.signals.items()), frame.contacts)).encode()
        states, controls = quanta.astype("<i4", copy=False), applied.astype("<i2", copy=False)
        self._chain.update(b"".join((self._names, states.tobytes(), controls.tobytes(), facts, *_bytes(heard))))
        self._digests.append(self._chain.digest())

    def finish(
        self, endings: Sequence[Ending], sent: Sequence[SentMessage] = (), thinking: Sequence[ThinkTime] = ()
    ) -> EpisodeRecord:
        """The read-only Episode of all that was added."""
        shape = (len(self._rows), len(self._columns))
        valid = np.zeros(shape, dtype=np.bool_)
        quanta = np.zeros((*shape, 4), dtype=np.int32)
        for tick, (columns, row) in enumerate(self._rows):
            valid[tick, columns] = True
            quanta[tick, columns] = row
        kind, length, width = zip(*self._facts, strict=True)
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
            controls=np.array(self._controls).reshape(shape[0], len(self._egos), 3),
            plans=tuple(self._plans),
            contacts=tuple(self._contacts),
            signals=tuple(self._signals),
            endings=tuple(endings),
            digests=np.frombuffer(b"".join(self._digests), dtype=np.uint8).reshape(shape[0], DIGEST_BYTES),
            messages=tuple(sent),
            notes=tuple(self._notes),
            thinking=tuple(thinking),
        )


def _bytes(heard: ReceivedMessages) -> Iterator[bytes]:
    """Delivered messages as the digest takes them, as each receiver got them."""
    for receiver, messages in heard.items():
        for m in messages:
            yield repr((receiver, m.sender, m.tick, m.type, len(m.payload))).encode()
            yield m.payload


def _row(ego: EgoState) -> tuple[float, float, float, float]:
    return ego.x, ego.y, ego.yaw, ego.speed
