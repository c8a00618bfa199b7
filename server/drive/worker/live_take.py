"""LiveTake: people drive a take in real time: inputs, clock, pauses, hand-overs, texts, and a frame for every tick."""

import pickle
import select
from collections.abc import Callable
from dataclasses import astuple
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.runs.takes import HUMAN, MAX_CHANGES, Action, DriverChoice, check_text
from server.drive.message_socket import MessageSocket
from server.drive.protocol import FrameState
from server.drive.simulation_values import (
    Behind,
    CallAnswer,
    DriveCall,
    DriveFrame,
    DriveProblem,
    HandedOver,
    PersonInput,
)
from server.drive.worker.collision_watch import CollisionWatch
from server.drive.worker.frame_builder import describe_messages
from server.drive.worker.input_queue import InputQueue
from server.drive.worker.journaled_take import JournaledTake
from server.drive.worker.motion import pack_motion
from server.drive.worker.orders import FinishOrder, LeaveOrder, Provenance
from server.drive.worker.take_journal import CavAction, TickActions
from server.drive.worker.tick_clock import TickClock

MAX_TEXTS_WAITING = 8
"""Texts of a CAV that wait for the next tick: the most that one tick may have."""


class LiveTake:
    """The take that people drive. It begins paused."""

    def __init__(self, take: JournaledTake, connection: MessageSocket, fork_checkpoint: Callable[[], None]) -> None:
        """fork_checkpoint: called in every tick of the ladder, after its frame is sent."""
        self._take, self._connection, self._fork_checkpoint = take, connection, fork_checkpoint
        self._clock = TickClock(take.context.setup.speed_up)
        self._queues = {cav: InputQueue() for cav in take.context.cavs}
        self._texts: dict[str, list[str]] = {}
        self._changes: dict[str, DriverChoice] = {}
        self._change_counts = dict.fromkeys(take.context.cavs, 0)
        self._held: TickActions | None = None
        self._state = FrameState.PAUSED
        self._teller = _FrameTeller(take)
        self.is_left = False
        """Whether its people have left it."""
        self.may_finish = False
        """Whether it has its turn to be finished, after it was left."""
        self.provenance = Provenance(take.order.device, take.order.latency_ms)
        """Of the inputs."""

    def run(self) -> None:
        """Let people drive until every CAV has ended or they leave. Raises EOFError, OSError without a supervisor."""
        self._tell()
        while not self._take.simulation.is_done:
            self._wait()
            if self.is_left:
                return
            self._advance()
        self._set_state(FrameState.FINISHED)

    def _wait(self) -> None:
        """Handle what the supervisor says until the next tick is due, or the people leave."""
        while not self.is_left:
            is_running = self._state != FrameState.PAUSED
            ready, _, _ = select.select([self._connection], [], [], self._clock.wait_s if is_running else None)
            if ready:
                for data in self._connection.receive():
                    self._handle(pickle.loads(data))  # of our own processes
            elif self._clock.wait_s == 0.0 and is_running:
                return

    def _handle(self, message: object) -> None:
        if isinstance(message, PersonInput):
            self._queues[message.cav].put(message.number, message.control)
        elif isinstance(message, Provenance):
            self.provenance = message
        elif isinstance(message, LeaveOrder):
            self.is_left = True
        elif isinstance(message, FinishOrder):
            self.may_finish = True
        elif isinstance(message, DriveCall):
            self._connection.send(self._answer(message))

    def _answer(self, call: DriveCall) -> CallAnswer:
        try:
            return CallAnswer(call.number, getattr(self, f"_call_{call.name}")(*call.arguments))
        except InputError as error:
            return CallAnswer(call.number, None, str(error))

    def _call_pause(self) -> None:
        if self._state != FrameState.PAUSED:
            self._set_state(FrameState.PAUSED)

    def _call_resume(self) -> None:
        if self._state == FrameState.PAUSED:
            for queue in self._queues.values():
                queue.keep(1)
            self._clock.start()
            self._set_state(FrameState.RUNNING)

    def _call_hand_over(self, cav: str, driver: str, options: dict[str, Any]) -> None:
        choice = self._take.context.check_driver(cav, driver, options)
        self._check_driven(cav)
        if self._change_counts[cav] + 1 >= MAX_CHANGES:
            raise InputError(f"hand-over: CAV {cav}: expected at most {MAX_CHANGES} changes of the driver in a take")
        self._changes[cav] = choice

    def _call_say(self, cav: str, text: str) -> None:
        check_text(text)
        self._check_driven(cav)
        texts = self._texts.setdefault(cav, [])
        if len(texts) >= MAX_TEXTS_WAITING:
            raise InputError(f"say: CAV {cav}: expected at most {MAX_TEXTS_WAITING} texts in a tick")
        texts.append(text)

    def _call_load_motion(self) -> bytes:
        take = self._take
        return pack_motion(take.order.header.take, take.simulation.frames, take.context.cavs)

    def _check_driven(self, cav: str) -> None:
        if cav not in self._take.simulation.driven_cavs:
            raise InputError(f"CAV {cav}: expected one whose drive goes on, found one that has ended")

    def _advance(self) -> None:
        """Drive one tick. A journal that cannot be written pauses the drive; the tick is then tried again."""
        actions = self._held or self._compose()
        changes = dict(self._take.changes)
        try:
            self._take.advance(actions)
        except OSError as error:
            self._held = actions
            self._set_state(FrameState.PAUSED)
            text = f"the drive is paused: its journal cannot be written: {error.strerror}; make room, then go on"
            self._connection.send(DriveProblem(text))
            return
        self._held = None
        self._clock.begin_tick()
        tick = self._take.simulation.tick
        for cav, choice in changes.items():
            self._connection.send(HandedOver(self._take.order.header.take, tick - 1, cav, choice.name))
        self._tell_speed()
        self._tell()
        if self._is_checkpoint_due(tick):
            self._fork_checkpoint()

    def _is_checkpoint_due(self, tick: int) -> bool:
        every = find_checkpoint_ticks(self._take.context.setup.checkpoint_s)
        return bool(every) and tick % every == 0 and not self._take.simulation.is_done

    def _compose(self) -> TickActions:
        """Return what happens in this tick: inputs, hand-overs and texts that have arrived."""
        take, cavs = self._take, {}
        for cav, choice in self._changes.items():
            if cav in take.simulation.driven_cavs and not take.is_driven_by(cav, choice):
                take.changes[cav] = choice
        self._changes = {}
        for cav in take.simulation.driven_cavs:
            change, texts = take.changes.get(cav), tuple(self._texts.pop(cav, ()))
            if change is not None:
                self._change_counts[cav] += 1
            number, control = 0, None
            if take.find_driver(cav) == HUMAN:
                number, control = self._queues[cav].take()
            else:
                self._queues[cav].release()
            if change is not None or control is not None or texts:
                cavs[cav] = CavAction(Action(change, control, texts), number)
        return TickActions(cavs)

    def _set_state(self, state: FrameState) -> None:
        self._state = state
        self._tell()

    def _tell(self) -> None:
        """Send a frame."""
        acks = {cav: queue.number for cav, queue in self._queues.items()}
        factor = round(self._clock.factor, 3)
        self._connection.send(self._teller.compose(self._state, acks, factor))

    def _tell_speed(self) -> None:
        """Change between running and slow, and say so; while it is slow, every two seconds."""
        state = FrameState.SLOW if self._clock.is_slow else FrameState.RUNNING
        tick = self._take.simulation.tick
        if state != self._state or (state == FrameState.SLOW and tick % (2 * TICKS_PER_SECOND) == 0):
            self._connection.send(Behind(self._take.order.header.take, round(self._clock.factor, 3)))
        self._state = state


def find_checkpoint_ticks(checkpoint_s: float) -> int:
    """Return the ticks between two checkpoints; 0: there are none."""
    return max(1, round(checkpoint_s * TICKS_PER_SECOND)) if checkpoint_s else 0


class _FrameTeller:
    """Composes the frames of a take: what is new in each of them, and everything in the first."""

    def __init__(self, take: JournaledTake) -> None:
        self._take = take
        self._is_first = True
        self._told_names = 0
        self._told_tick = -1
        self._collisions = CollisionWatch()
        self._told: dict[str, dict[str, str]] = {"signals": {}, "endings": {}, "drivers": {}}

    def compose(self, state: FrameState, acks: dict[str, int], factor: float) -> DriveFrame:
        """Return the frame of the current tick. acks: number of the last used input by CAV."""
        take = self._take
        simulation, frame = take.simulation, take.simulation.frame
        extra: dict[str, Any] = {}
        names = simulation.frames.names
        if len(names) > self._told_names:
            extra["names"] = names[self._told_names :]
            self._told_names = len(names)
        now = {
            "signals": dict(frame.signals),
            "endings": {cav: str(ending.end) for cav, ending in simulation.episode.endings.items()},
            "drivers": {cav: take.find_driver(cav) for cav in take.context.cavs},
        }
        for key, values in now.items():
            new = {name: value for name, value in values.items() if self._told[key].get(name) != value}
            if new or self._is_first:
                extra[key] = new
        if frame.tick > self._told_tick:
            messages = simulation.episode.received_messages
            if described := describe_messages(messages, simulation.station_names, take.context.origin):
                extra["messages"] = described
            if begun := self._collisions.find_begun(frame):
                extra["collisions"] = begun
        if state == FrameState.SLOW or frame.tick % TICKS_PER_SECOND == 0:
            extra["factor"] = factor
        self._told, self._told_tick, self._is_first = now, frame.tick, False
        states = simulation.vehicle_states
        own = {cav: astuple(states[cav]) for cav in frame.egos}
        return DriveFrame(take.order.header.take, frame.tick, state, acks, own, simulation.frames.rows[-1], extra)
