"""RecordedActions: the actions in one car, read from a recording."""

from collections import defaultdict
from itertools import pairwise

from mdrive_sumo.contract import DRIVER, Control, Message, Note
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT, FailureReason
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.loop.human_actions import RECORDING, Action, DriverChoice, is_remark, make_control
from mdrive_sumo.v2x.messages import TEXT, MessageError, decode


class RecordedActions:
    """An `ActionSource`: what happened in the car of a CAV in a recorded take, or, entered, in any recorded run."""

    def __init__(self, record: EpisodeRecord, ego: str, *, is_entered: bool = False) -> None:
        """is_entered: the run is no take, or shall be repeated without its drivers: `RECORDING` drives from tick 0.

        Raises InputError for a CAV that the recording has not, and for damaged notes.
        """
        if ego not in record.ego_ids:
            raise InputError(f"recording of {record.scenario}: expected a CAV {ego!r:.60}, found none")
        self._place = f"recording of {record.scenario}: CAV {ego}"
        self._ending = record.find_ending(ego)
        self._controls = record.controls[:, record.ego_ids.index(ego)]
        self._messages: dict[int, list[Message]] = defaultdict(list)
        for sent in record.messages:
            if sent.message.sender == ego:
                if record.is_payload_dropped(sent):
                    raise InputError(
                        f"{self._place}: expected the content of its messages, found a recording without that of"
                        f" {sent.message.type} (--no-record-features), which cannot be driven again"
                    )
                self._messages[sent.message.tick].append(sent.message)
        self._notes: dict[int, list[Note]] = defaultdict(list)
        for one in record.notes:
            if one.ego == ego:
                self._notes[one.tick].append(one.note)
        self.drivers: dict[int, DriverChoice] = {0: DriverChoice(RECORDING)} if is_entered else self._read_drivers()
        """The drivers, by the tick in which they begin."""

    @property
    def end_tick(self) -> int:
        """The tick from which on there are no actions: the CAV has ended, or its agent failed."""
        failed = self._ending.failed_tick
        last = min(self._ending.tick, len(self._controls))
        return last if failed is None else min(failed, last)

    def read(self, tick: int) -> Action:
        """See ActionSource."""
        if tick >= self.end_tick:
            raise self._make_end(tick)
        notes, messages = self._notes.get(tick, ()), self._messages.get(tick, ())
        control = self._read_control(tick)
        if self.find_driver(tick).name == RECORDING:
            kept = tuple(note for note in notes if note.kind != DRIVER)
            sent = tuple(Message(one.type, one.payload) for one in messages)
            return Action(self.drivers.get(tick), control, (), kept, sent)
        texts = tuple(self._read_text(tick, one) for one in messages if one.type == TEXT)
        return Action(self.drivers.get(tick), control, texts, tuple(filter(is_remark, notes)))

    def find_driver(self, tick: int) -> DriverChoice:
        """Return the driver of a tick."""
        return self.drivers[max(begin for begin in self.drivers if begin <= tick)]

    def list_person_ticks(self) -> list[int]:
        """Return the ticks in which a person drove."""
        spans = pairwise((*sorted(self.drivers), self.end_tick))
        ranges = (range(begin, end) for begin, end in spans if self.drivers[begin].name == HUMAN)
        return [tick for ticks in ranges for tick in ticks if tick < self.end_tick]

    def _make_end(self, tick: int) -> AgentFailure:
        """Return the recorded failure; without one, that the recorded drive is over while the CAV still drives."""
        if self._ending.failure is not None and tick == self._ending.failed_tick:
            return AgentFailure(self._ending.failure, self._ending.text)
        return AgentFailure(FailureReason.LEFT, f"the recorded drive ends at tick {tick} ({tick * DT:.2f} s)")

    def _read_drivers(self) -> dict[int, DriverChoice]:
        drivers: dict[int, DriverChoice] = {}
        for tick, notes in sorted(self._notes.items()):
            found = [note for note in notes if note.kind == DRIVER]
            if len(found) > 1:
                raise InputError(f"{self._place}: tick {tick}: expected one driver note, found {len(found)}")
            for note in found:
                try:
                    drivers[tick] = DriverChoice.from_note(note)
                except InputError as error:
                    raise InputError(f"{self._place}: tick {tick}: {error}") from None
        if 0 not in drivers and self.end_tick > 0:
            raise InputError(f"{self._place}: expected a take, with a driver note in its first tick, found none")
        return drivers

    def _read_control(self, tick: int) -> Control:
        throttle, brake, steer = self._controls[tick].tolist()
        try:
            return make_control((throttle, brake, steer))
        except InputError as error:
            raise InputError(f"{self._place}: tick {tick}: {error}") from None

    def _read_text(self, tick: int, message: Message) -> str:
        try:
            return str(decode(message))
        except MessageError as error:
            raise InputError(f"{self._place}: tick {tick}: text: {error}") from None
