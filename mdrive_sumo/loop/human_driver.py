"""HumanDriver: the driver of a CAV that people and agents drive in turn. Every CAV of a take has one."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mdrive_sumo.contract import DRIVER, REMARK, Agent, Briefing, Control, Message, Note, Observation, Reply, SensorSpec
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver, validate_reply
from mdrive_sumo.loop.human_actions import RECORDING, Action, ActionSource, DriverChoice, is_remark
from mdrive_sumo.v2x.messages import CAM, TEXT, encode

if TYPE_CHECKING:  # it imports planning, which no other run needs
    from mdrive_sumo.agents.human import HumanAgent

ROLLING = Control(throttle=0.0, brake=0.0, steer=0.0)
"""What a car does that a person has just taken over without touching anything."""
MAX_CHANGES = 200
"""Changes of the driver of a CAV in an episode, each of which the recording notes (`episode.recorder`): 8 CAVs have as
many as there is room for."""


class HumanDriver:
    """An `AgentDriver`: asks an `ActionSource` for the driver, and gives that driver's reply.

    While a person drives: the control of the device, the texts, and what the car sends by itself. While an agent
    drives: its reply, and the person's texts. While a recording drives: what it holds.
    """

    def __init__(
        self, ego: str, actions: ActionSource | None, agent: "HumanAgent", watching: tuple[SensorSpec, ...] = ()
    ) -> None:
        """agent: what is on board. actions: None: no driver, which is enough to declare sensors.

        watching: more sensors, for who watches the drive.
        """
        self._watching = watching
        self._ego, self._actions, self._agent = ego, actions, agent
        self._on_board = LocalDriver(agent)
        self.briefing: Briefing | None = None
        """What the driver is told before the first tick; None before that."""
        self._seen: Observation | None = None
        self._substitute: LocalDriver | None = None
        self._control = ROLLING
        self._changes = 0
        self.driver: DriverChoice | None = None
        """The driver; None before the first tick."""
        self.label = self._on_board.label
        self.think_time_s = 0.0

    @property
    def seen(self) -> Observation | None:
        """The latest observation of the CAV."""
        return self._seen

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See AgentDriver."""
        return (*self._on_board.sensors(), *self._watching)

    def start(self, briefing: Briefing) -> None:
        """See AgentDriver."""
        self.briefing = briefing
        self._on_board.start(briefing)

    def ask(self, observation: Observation) -> None:
        """See AgentDriver."""
        self._seen = observation

    def send(self) -> None:
        """See AgentDriver."""

    def close(self) -> None:
        """See AgentDriver."""

    def answer(self) -> Reply:
        """Return the reply of the driver. Raises AgentFailure (`LEFT` without one), InputError for a bad action."""
        assert self._seen is not None
        since = time.perf_counter()
        action = self._read(self._seen.tick)
        notes = self._change_driver(action.driver, self._seen.tick)
        reply = validate_reply(self._compose_reply(action, self._seen, notes))
        self.think_time_s = time.perf_counter() - since
        return reply

    def _read(self, tick: int) -> Action:
        if self._actions is None:
            raise InputError(f"agent {self._agent.name}: expected a driver of CAV {self._ego}, found none")
        return self._actions.read(tick)

    def _change_driver(self, choice: DriverChoice | None, tick: int) -> tuple[Note, ...]:
        """Let another driver begin; return the note of it."""
        if choice is None:
            if self.driver is None:
                raise InputError(f"CAV {self._ego}: tick {tick}: expected a driver, found none")
            return ()
        if choice.name == RECORDING and self.driver is not None:
            raise InputError(f"CAV {self._ego}: tick {tick}: expected a recording to drive from the begin only")
        self._changes += 1
        if self._changes > MAX_CHANGES:
            raise AgentFailure(FailureReason.INVALID, f"expected at most {MAX_CHANGES} changes of the driver")
        self.driver, self._substitute = choice, None
        if choice.name not in (HUMAN, RECORDING):
            assert self.briefing is not None
            self._substitute = LocalDriver(self._make_substitute(choice, tick))
            self._substitute.start(self.briefing)
        return (choice.to_note(),)

    def _make_substitute(self, choice: DriverChoice, tick: int) -> Agent:
        try:
            return self._agent.make_substitute(choice.name, choice.config)
        except InputError as error:
            raise InputError(f"CAV {self._ego}: tick {tick}: {error}") from None

    def _compose_reply(self, action: Action, seen: Observation, notes: tuple[Note, ...]) -> Reply:
        said = tuple(encode(text) for text in action.texts)
        assert self.driver is not None
        is_recording = self.driver.name == RECORDING
        for note in action.notes:
            if note.kind == DRIVER or not (is_recording or is_remark(note)):
                raise InputError(f"CAV {self._ego}: expected notes of kind {REMARK}, found {note.kind!r:.40}")
        notes += action.notes
        if self._substitute is not None:
            return self._ask_substitute(self._substitute, seen, said, notes)
        self._control = action.control if action.control is not None else self._control
        messages = self._repeat(action.messages, seen.tick) if is_recording else self._agent.compose_messages(seen)
        return Reply(self._control, messages=messages + said, notes=notes)

    def _ask_substitute(
        self, substitute: LocalDriver, seen: Observation, said: tuple[Message, ...], notes: tuple[Note, ...]
    ) -> Reply:
        """Return the reply of the agent that drives; the texts of a take are those of people."""
        substitute.ask(seen)
        reply = substitute.answer()
        messages = tuple(message for message in reply.messages if message.type != TEXT)
        self._note_awareness(messages, seen.tick)
        self._control = reply.control or ROLLING
        return Reply(reply.control, reply.plan, messages + said, notes + reply.notes, reply.detections)

    def _repeat(self, messages: tuple[Message, ...], tick: int) -> tuple[Message, ...]:
        self._note_awareness(messages, tick)
        return messages

    def _note_awareness(self, messages: Sequence[Message], tick: int) -> None:
        """Keep the rhythm of CAMs and CPMs when another driver of the car has sent them."""
        if any(message.type == CAM for message in messages):
            self._agent.postpone_messages(tick)
