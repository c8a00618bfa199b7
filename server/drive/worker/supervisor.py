"""DriveSupervisor: the process between the server and the simulations of a drive. It runs no simulation itself.

It loads the scenario once, forks a process per take, holds the sockets of all checkpoints, keeps the tree of takes on
disk, and gives takes that were left their turn. Every connection of the drive ends here, so when the server is gone,
this process ends, and with it, by the end of their connections, all others.
"""

import gc
import pickle
import select
import socket
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.runs.process_pool import count_available_cores
from server.drive.message_socket import MessageSocket
from server.drive.protocol import FrameState
from server.drive.simulation_values import (
    CallAnswer,
    DriveCall,
    DriveFrame,
    DriveProblem,
    DriveSetup,
    HandedOver,
    PersonInput,
    TakeEnded,
    TakeStarted,
)
from server.drive.take_tree import Take, TakeStatus
from server.drive.worker.child import Child, ChildProcesses, ChildRole
from server.drive.worker.drive_folder import check_tick
from server.drive.worker.motion_calls import MotionCalls
from server.drive.worker.open_drive import OpenDrive
from server.drive.worker.orders import (
    CheckpointMade,
    LeaveOrder,
    MotionLoaded,
    Provenance,
    TakeAlive,
    TakeDropped,
    TakeFinished,
    TakeMode,
    TakeOrder,
    TakeReady,
    TakeRefused,
    WhatIfDone,
)
from server.drive.worker.take_process import TAKE_IS_OVER
from server.drive.worker.waiting_takes import WaitingTakes
from server.drive.worker.watchdog import WATCH_S, Watchdog
from server.drive.worker.what_if_calls import WhatIfCalls

RETRY_S = 2.0
"""Time after which a tree that could not be written is written again [s]."""
PASSED_CALLS = ("pause", "resume", "hand_over", "say")
"""Calls that the process of the live take answers."""


class DriveSupervisor:
    """One drive, from its `open` to the end of the connection to the server."""

    def __init__(self, server: MessageSocket) -> None:
        self._server = server
        self._drive: OpenDrive | None = None
        self._children = ChildProcesses(server)
        self._watchdog = Watchdog(DriveSetup.tick_limit_s)
        self._live: Child | None = None
        self._starting: tuple[Child, int] | None = None
        """The process of a take that begins, and the number of the call that waits for it."""
        self._finish_calls: list[int] = []
        self._motions = MotionCalls(self._children, self._answer)
        self._slots = max(1, count_available_cores() - 1)
        """Processes that work in the background at a time: one core is left to the live take."""
        self._waiting = WaitingTakes(
            self._children,
            self._slots,
            lambda take, count: self.drive.make_order(take, take, count, TakeMode.FINISH),
            lambda order: self._start(order, ChildRole.FINISHING),
        )
        self._what_ifs = WhatIfCalls(self._children, self._slots, lambda order: self._start(order, ChildRole.HELPING))

    def run(self) -> None:
        """Serve until the server closes the connection."""
        with suppress(EOFError, ConnectionError):
            while True:
                sockets = [self._server, *(child.connection for child in self._children)]
                is_unsaved = self._drive is not None and self._drive.stored.is_unsaved
                begin_s = time.monotonic()
                ready, _, _ = select.select(sockets, [], [], self._choose_wait_s(is_unsaved=is_unsaved))
                waited_s = time.monotonic() - begin_s
                if is_unsaved and not ready:
                    self.drive.stored.save()
                for child in [one for one in self._children if one.connection in ready]:
                    self._read_child(child)
                if self._server in ready:
                    for data in self._server.receive():
                        self._handle(pickle.loads(data))  # of our own server
                for child in self._watchdog.find_hanging(self._children, waited_s):
                    self._children.end(child)
                    self._drop(child, is_hanging=True)

    def _choose_wait_s(self, *, is_unsaved: bool) -> float | None:
        if self._watchdog.is_needed(self._children):
            return WATCH_S
        return RETRY_S if is_unsaved else None

    # ------------------------------------------------------------------------------------------ calls of the server

    def _handle(self, message: object) -> None:
        if isinstance(message, PersonInput):
            if self._live is not None:
                self._live.tell_if_ready(message)
            return
        assert isinstance(message, DriveCall), "expected a call"
        try:
            if message.name in PASSED_CALLS:
                self._pass_on(message)
            else:
                getattr(self, f"_call_{message.name}")(message.number, *message.arguments)
        except (InputError, WorldError) as error:
            self._answer(message.number, None, str(error))
        except OSError as error:  # of the server's connection: that ends in `run`
            if error.filename is None:
                raise
            self._answer(message.number, None, f"{error.filename}: {error.strerror}")

    def _answer(self, number: int, value: Any = None, problem: str = "") -> None:
        self._server.send(CallAnswer(number, value, problem))

    def _pass_on(self, call: DriveCall) -> None:
        if self._live is not None:
            self._live.calls[call.number] = call.name
            self._live.tell(call)
        elif call.name == "pause":
            self._answer(call.number)
        else:
            raise InputError(f"{call.name}: expected a take that goes on, found none; go back to a tick to drive on")

    def _call_open(self, number: int, setup: DriveSetup) -> None:
        drive = self._drive = OpenDrive(setup, self._server.send)
        self._watchdog = Watchdog(setup.tick_limit_s)
        self._waiting.add(drive.unfinished.takes)
        gc.collect()
        gc.freeze()  # else the first collection of each fork would write to, and so copy, all that they share
        for problem in drive.unfinished.problems:
            self._server.send(DriveProblem(problem))
        drive.stored.save()
        parent, tick = drive.unfinished.go_on or (None, drive.first_tick)
        self._begin(number, parent, tick)
        self._give_turns()

    def _call_ping(self, number: int) -> None:
        self._answer(number)

    def _call_branch(self, number: int, take: int, tick: int) -> None:
        check_tick(self.drive.tree, take, tick)
        if self._starting is not None:
            raise InputError("branch: expected one at a time, found another one that begins")
        if self._live is not None:
            self._live.tell(DriveCall(0, "pause"))
        self._begin(number, take, tick)

    def _call_leave(self, number: int) -> None:
        self._leave_live()
        self._answer(number)

    def _call_finish(self, number: int) -> None:
        self._leave_live()
        self._finish_calls.append(number)
        self._give_turns()

    def _call_note(self, number: int, device: str, latency_ms: float) -> None:
        self.drive.provenance = Provenance(device, latency_ms)
        if self._live is not None:
            self._live.tell(self.drive.provenance)
        self._answer(number)

    def _call_load_motion(self, number: int, take: int) -> None:
        self.drive.tree.find(take)
        found = (one for one in self._children if one.take == take and one.role is not ChildRole.HELPING)
        if (child := next(found, None)) is not None:
            child.calls[number] = "load_motion"
            child.tell(DriveCall(number, "load_motion"))
        else:
            self._motions.ask(number, take, self.drive)

    def _call_what_if(
        self, number: int, take: int, tick: int, agents: tuple[str, ...], seconds: float, cavs: tuple[str, ...]
    ) -> None:
        check_tick(self.drive.tree, take, tick)
        self.drive.context.check_substitutes(agents, cavs)
        self._what_ifs.add(number, agents)
        order = replace(self.drive.make_order(take, take, tick, TakeMode.HOLD), seconds=seconds, cavs=cavs)
        key = self._children.ladder.find(self.drive.tree.list_line(take), tick)
        if key is not None and key[1] == tick:
            self._what_ifs.go_on(number, order)
        else:
            self._start(order, ChildRole.HELPING).calls[number] = "what_if"

    # ------------------------------------------------------------------------------------------------------- takes

    @property
    def drive(self) -> OpenDrive:
        """What is driven, and the takes on disk. Raises InputError before `open`."""
        if self._drive is None:
            raise InputError("drive: expected open() before anything else")
        return self._drive

    def _begin(self, number: int, parent: int | None, tick: int) -> None:
        """Start the process of a new take. number: of the call that is answered when it is in its tick."""
        order = self.drive.order_new_take(parent, tick)
        self._starting = self._start(order, ChildRole.STARTING), number

    def _start(self, order: TakeOrder, role: ChildRole) -> Child:
        parent = order.header.parent
        return self._children.start(
            self.drive.context, order, self.drive.tree.list_line(parent) if parent is not None else (), role
        )

    def _leave_live(self) -> None:
        if self._live is not None:
            child, self._live = self._live, None
            child.role = ChildRole.LEFT
            self.drive.stored.note_left(child.take, child.tick)
            child.tell(LeaveOrder())
            self._give_turns()

    def _give_turns(self) -> None:
        """Let takes that were left be finished; answer `finish` after the last."""
        is_idle = self._waiting.give_turns(self.drive.stored, self._server, is_starting=self._starting is not None)
        if is_idle and self._starting is None:
            for number in self._finish_calls:
                self._answer(number)
            self._finish_calls = []
            if not self._children.count(ChildRole.HELPING):
                self._motions.load_ahead(self.drive)

    # --------------------------------------------------------------------------------------------------- processes

    def _read_child(self, child: Child) -> None:
        try:
            messages = child.connection.receive()
        except (EOFError, OSError):
            self._drop(child)
            return
        child.silent_s = 0.0
        for data in messages:
            self._hear(child, pickle.loads(data), data)  # of our own processes

    def _hear(self, child: Child, message: object, data: bytes) -> None:
        """Handle what a process says; what is for the server is passed on as it came."""
        match message:
            case CheckpointMade():
                self._hear_checkpoint(child, message)
            case TakeAlive():
                child.process = message.process
            case MotionLoaded():
                self._motions.hear(child, message)
            case TakeReady():
                self._hear_ready(child, message)
            case TakeRefused():
                self._hear_refused(child, message)
            case TakeFinished():
                self._hear_finished(child, message)
            case TakeDropped():
                self._hear_dropped(child, message)
            case WhatIfDone():
                for number, branches in self._what_ifs.hear(child, message):
                    self._answer(number, branches)
            case _:
                self._pass_back(child, message, data)

    def _pass_back(self, child: Child, message: object, data: bytes) -> None:
        """Pass on what is for the server."""
        if isinstance(message, HandedOver):
            self.drive.stored.note_driver(message)
        if isinstance(message, DriveFrame):
            child.frame = message
        if isinstance(message, CallAnswer):
            child.calls.pop(message.number, None)
        if not isinstance(message, CallAnswer) or message.number:
            self._server.send_bytes(data)

    def _hear_checkpoint(self, child: Child, message: CheckpointMade) -> None:
        connection = MessageSocket(socket.socket(fileno=child.connection.take_descriptor()))
        line = self.drive.tree.list_line(self._live.take) if self._live is not None else ()
        self._children.ladder.add(message.take, message.tick, connection, line)
        self._what_ifs.hear_checkpoint(child, message.tick)

    def _hear_dropped(self, child: Child, message: TakeDropped) -> None:
        child.role = ChildRole.HELPING  # it has nothing more to do than to end
        self._children.ladder.move_take(message.take, self.drive.tree.find(message.take).parent)
        self.drive.stored.drop(message.take)

    def _hear_ready(self, child: Child, message: TakeReady) -> None:
        assert self._starting is not None and self._starting[0] is child, "expected the take that begins"
        number, header = self._starting[1], message.header
        self._starting = None
        self._leave_live()
        child.role, self._live = ChildRole.LIVE, child
        take = Take(header.take, header.parent, header.tick, message.drivers)
        self.drive.stored.add(take)
        self._server.send(TakeStarted(take.number, take.parent, take.tick, take.drivers))
        is_first = self._facts_are_due
        self._facts_are_due = False
        context = self.drive.context
        self._answer(number, (context.make_facts(), context.pack_scene()) if is_first else take.number)
        self._give_turns()

    _facts_are_due = True

    def _hear_refused(self, child: Child, message: TakeRefused) -> None:
        if self._starting is not None and self._starting[0] is child:
            number, order = self._starting[1], child.order
            self._starting = None
            self._children.ladder.drop_take(child.take)
            assert order is not None
            if self._facts_are_due and self._begin_otherwise(number, order, message):
                return
            self._answer(number, None, message.text)
        elif child.role in (ChildRole.LIVE, ChildRole.LEFT, ChildRole.FINISHING):
            self._stop_live(child)
            child.role = ChildRole.HELPING  # it has nothing more to do than to end, which is no other problem
            self.drive.stored.change(child.take, status=TakeStatus.VOID)
            self._fail_calls(child, message.text)
            self._server.send(DriveProblem(f"take {child.take} cannot be finished: {message.text}"))
        else:
            self._fail_calls(child, message.text)

    def _begin_otherwise(self, number: int, order: TakeOrder, message: TakeRefused) -> bool:
        """Begin the first take of a session in another way; return whether there is one.

        Agents of an entered run that drive differently now are replaced by their recorded replies. A take of an earlier
        session that has no tick from which to go on is followed by one from the start.
        """
        if message.has_diverged and self.drive.repeat_recording():
            self._begin(number, order.header.parent, order.header.tick)
            return True
        if order.header.parent is not None:
            self._begin(number, None, self.drive.first_tick)
            return True
        return False

    def _hear_finished(self, child: Child, message: TakeFinished) -> None:
        if child is self._live:
            self._live = None
        child.role = ChildRole.HELPING  # it has nothing more to do than to end
        self._motions.keep(message.take, message.motion)
        self.drive.stored.note_finished(message)
        left = message.left_tick is not None
        self._server.send(TakeEnded(message.take, message.end_tick, message.score, message.ds, left))

    def _stop_live(self, child: Child) -> None:
        """If it is the live take that ends before its time, let pages see that: its last frame, with another state."""
        if child is self._live:
            self._live = None
            if child.frame is not None:
                self._server.send(replace(child.frame, state=FrameState.FINISHED, extra={}))

    def _drop(self, child: Child, *, is_hanging: bool = False) -> None:
        """Forget a process that has ended, and say so if it should not have. is_hanging: it was ended for that."""
        self._children.remove(child)
        self._fail_calls(child, "the process that computed it has ended; try again")
        if self._starting is not None and self._starting[0] is child:
            number = self._starting[1]
            self._starting = None
            self._children.ladder.drop_take(child.take)
            self._answer(number, None, "the process of the take has ended; try again")
        elif child.role is ChildRole.ASIDE:
            self._waiting.add((child.take,), self.drive.provenance)
        elif child.role in (ChildRole.LIVE, ChildRole.LEFT, ChildRole.FINISHING):
            if child is self._live:
                self.drive.stored.note_left(child.take, child.tick)
            else:
                self.drive.stored.change(child.take, status=TakeStatus.LEFT)
            self._stop_live(child)
            self._waiting.add_lost(child.take, self.drive.provenance)
            why = self._watchdog.describe(child) if is_hanging else "has ended"
            text = f"the process of take {child.take} {why}; its actions are kept: go back to a tick to drive on"
            self._server.send(DriveProblem(text))
        self._give_turns()

    def _fail_calls(self, child: Child, text: str) -> None:
        """Answer what a process has not answered before its end."""
        calls, child.calls = child.calls, {}
        take = self.drive.tree.takes.get(child.take)
        is_stored = take is not None and take.status is TakeStatus.FINISHED
        for number, name in calls.items():
            self._what_ifs.drop(number)
            if name == "load_motion" and is_stored:
                self._call_load_motion(number, child.take)  # of its recording
            elif name == "pause":
                self._answer(number)
            else:
                self._answer(number, None, TAKE_IS_OVER if is_stored else text)
