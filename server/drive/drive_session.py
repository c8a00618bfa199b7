"""DriveSession: the people of one drive, which of them drives which CAV, and when its clock runs.

The clock runs while every person's CAV has its driver there, and every driver has sent `resume`. A driver who pauses
stops it for all until this driver resumes. One whose connection is lost stops it, too, or hands the CAV to an agent
(`SessionRules.on_disconnect`); a driver who comes back within `patience_s` goes on where the drive stands.
"""

import asyncio
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import replace
from statistics import median
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.runs.takes import HUMAN
from server.drive import messages
from server.drive.access import Seat, SeatRole
from server.drive.browser_connection import GOING_AWAY, NORMAL, BrowserConnection
from server.drive.drive_people import DrivePeople
from server.drive.messages import GhostsOut, NoticeOut, PongOut, ProblemOut, TreeOut, WaitingOut
from server.drive.protocol import FrameState, InputDevice, ProtocolError, decode_input
from server.drive.session_answers import build_welcome, list_ghosts, list_takes
from server.drive.session_rules import PAUSE, SessionRules
from server.drive.simulation_process import (
    DriveProblem,
    Event,
    HandedOver,
    SimulationEnded,
    SimulationProcess,
    TakeEnded,
    TakeStarted,
    TreeChanged,
)
from server.drive.simulation_values import DriveFrame

WATCH_S = 0.25
"""Interval in which the session looks for silent and late drivers [s]."""
UNKNOWN_DEVICE = "unknown"
"""Device of a take whose people drive with different ones, see `agents.human.DEVICES`."""
MAX_SPECTATORS = 50
"""Of one drive: each costs as much to send to as a driver."""


class DriveSession:
    """People and one simulation. All methods run in one event loop."""

    def __init__(
        self,
        name: str,
        simulation: SimulationProcess,
        rules: SessionRules | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """simulation: opened. clock: monotonic time [s]."""
        self.name = name
        self.simulation = simulation
        self.rules = rules or SessionRules()
        self.people = DrivePeople(simulation.facts.people, self.rules.patience_s, clock)
        self.frame: DriveFrame | None = None
        """The last one."""
        self.has_ended = False
        """Whether the simulation is gone."""
        self._clock = clock
        self._driver_by_cav = {cav: HUMAN if cav in self.people.seats else "" for cav in simulation.facts.cavs}
        self._ended: set[str] = set()
        """CAVs whose drive has ended in the take that goes on: that of the last frame, until another one begins."""
        self._connections: list[BrowserConnection] = []
        self._is_running = False
        self._is_finished = False
        self._waiting: WaitingOut | None = None
        self._noted: tuple[str, float] | None = None
        self._lock = asyncio.Lock()
        self._what_if: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Pass on what happens in the simulation until it ends; look for silent and late drivers."""
        watch = asyncio.create_task(self._watch())
        try:
            async for event in self.simulation.events():
                self._receive_event(event)
        finally:
            watch.cancel()
            self.has_ended = True
            for connection in [*self._connections]:
                connection.close(GOING_AWAY, "the simulation has ended")

    async def close(self, wait_s: float) -> None:
        """Close all connections, leave the live take and end the simulation.

        wait_s: time for takes that are being finished [s].
        """
        for connection in [*self._connections]:
            connection.close(GOING_AWAY, "the server ends; the drive can be continued with --resume")
        await self.simulation.close(wait_s)

    def _receive_event(self, event: Event) -> None:
        if isinstance(event, DriveFrame):
            self._receive_frame(event)
        elif isinstance(event, TakeStarted):
            self._driver_by_cav.update(event.drivers)
            self._is_finished = self._is_running = False
            self._ended.clear()
            for seat in self.people.seats.values():
                seat.noted_device = InputDevice.KEYBOARD if event.parent is None else None
            self._put_tree()
        elif isinstance(event, HandedOver):
            self._driver_by_cav[event.cav] = event.driver
            self._spawn(self.update_clock())
        elif isinstance(event, TreeChanged | TakeEnded):
            self._put_tree()
        elif isinstance(event, DriveProblem):
            self._broadcast(ProblemOut(text=event.text))
        # what is left is `Behind`: state and factor of the frames say so

    def _receive_frame(self, frame: DriveFrame) -> None:
        self.frame = frame
        self._driver_by_cav.update(frame.extra.get("drivers", {}))
        self._ended.update(frame.extra.get("endings", {}))
        if frame.state == FrameState.FINISHED and not self._is_finished:
            self._is_finished, self._is_running = True, False
            self.people.forget_readiness()
        known = self.simulation.known_extra
        for connection in self._connections:
            connection.put_frame(frame, known, self._is_shown)

    def _is_shown(self, kind: str) -> bool:
        return self.rules.chat if kind == "text" else self.rules.v2x_view

    def _put_tree(self) -> None:
        current = self.frame.take if self.frame else 1
        self._broadcast(TreeOut(takes=list_takes(self.simulation.tree, self.frame), current=current))

    def _broadcast(self, answer: messages.DriveAnswer) -> None:
        for connection in self._connections:
            connection.put(answer)

    def _notify(self, text: str, but: BrowserConnection | None = None) -> None:
        for connection in self._connections:
            if connection is not but:
                connection.put(NoticeOut(text=text))

    # ----------------------------------------------------------------------------------------------- people and clock

    def connect(self, seat: Seat) -> BrowserConnection:
        """Return the connection of a browser that has a seat. Raises InputError if the seat is taken."""
        if self.has_ended:
            raise InputError("the simulation of this drive has ended; it is started anew, try again in a few seconds")
        connection = BrowserConnection(seat, self._clock)
        if seat.role == SeatRole.DRIVER:
            if self.people.take_seat(connection):
                self._notify(f"CAV {connection.cav}: its driver is back")
            self._spawn(self._give_back(connection.cav))
        elif sum(not one.is_driver for one in self._connections) >= MAX_SPECTATORS:
            raise InputError(f"spectators: expected at most {MAX_SPECTATORS} at a time; close another page first")
        self._connections.append(connection)
        connection.put(build_welcome(self.simulation, self.rules, connection.cav, self.frame, self._list_cavs()))
        if self.frame is not None:
            connection.put_frame(self.frame, self.simulation.known_extra, self._is_shown)
        if self._waiting is not None:
            connection.put(self._waiting)
        return connection

    def _list_cavs(self) -> Mapping[str, tuple[str, bool]]:
        seats = self.people.seats
        return {
            cav: (driver, cav in seats and seats[cav].connection is not None)
            for cav, driver in self._driver_by_cav.items()
        }

    async def _give_back(self, cav: str) -> None:
        """Let a driver who is back drive again if an agent stands in."""
        seat = self.people.seats[cav]
        stand_in, seat.stand_in = seat.stand_in, ""
        if stand_in and self._driver_by_cav[cav] == stand_in and not self._is_finished:
            await self._take_wheel(cav)
        await self.update_clock()

    def disconnect(self, connection: BrowserConnection, *, for_good: bool = False) -> None:
        """Forget a browser. for_good: without time to come back."""
        if connection in self._connections:
            self._connections.remove(connection)
        if self.people.leave_seat(connection, for_good=for_good) and not self.has_ended:
            self._notify(f"CAV {connection.cav}: its driver is gone")
            self._spawn(self._replace_driver(connection.cav))

    async def _replace_driver(self, cav: str) -> None:
        """Let an agent drive on if the rules say so, and look for which drivers the clock waits."""
        agent = self.rules.on_disconnect
        if agent != PAUSE and self._driver_by_cav[cav] == HUMAN and not self._is_finished:
            self.people.seats[cav].stand_in = agent
            with suppress(InputError, SimulationEnded):  # its drive has ended
                await self._set_driver(cav, agent)
        await self.update_clock()

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(WATCH_S)
            await self.update_clock()
            await self._note_inputs()

    async def _note_inputs(self) -> None:
        """Tell the simulation with what people drive and how late their inputs come, where that has changed."""
        latencies = [one.latency_ms for one in self._connections if one.is_driver and one.latency_ms is not None]
        if not latencies or self.has_ended:
            return
        devices = [seat.device_name for seat in self.people.seats.values()]
        noted = (devices[0] if len({*devices}) == 1 else UNKNOWN_DEVICE, float(round(median(latencies))))
        if noted != self._noted:
            self._noted = noted
            with suppress(InputError, SimulationEnded):  # provenance; the drive does not depend on it
                await self.simulation.note_input(*noted)

    async def update_clock(self) -> None:
        """Stop or start the clock as the people are there and ready, and tell them for which drivers it waits."""
        async with self._lock:
            for cav in self.people.end_patience():
                self._notify(f"CAV {cav}: its driver has not come back; another driver can hand it over to an agent")
            awaited = [cav for cav in self.people.list_awaited(self._driver_by_cav) if cav not in self._ended]
            should_run = not awaited and not self._is_finished and self.frame is not None
            if should_run != self._is_running and not self.has_ended:
                await self._set_clock(should_run)
            waiting = self.people.describe_wait(awaited)
            if waiting != self._waiting:
                self._waiting = waiting
                self._broadcast(waiting)

    async def _set_clock(self, should_run: bool) -> None:
        try:
            await (self.simulation.resume() if should_run else self.simulation.pause())
            self._is_running = should_run
        except InputError as error:
            self.people.forget_readiness()  # else it would be tried again and again
            self._broadcast(ProblemOut(text=str(error)))
        except SimulationEnded:
            self._is_running = False

    # ------------------------------------------------------------------------------------------- people to simulation

    async def receive(self, connection: BrowserConnection, message: bytes | str) -> None:
        """Do what a browser asks for; what cannot be done costs one sentence to it."""
        if not connection.allow(message):
            return
        try:
            if isinstance(message, bytes):
                self._receive_input(connection, message)
            else:
                await self._receive_request(connection, messages.decode_request(message))
        except (InputError, SimulationEnded) as error:
            connection.put_problem(str(error))

    def _receive_input(self, connection: BrowserConnection, message: bytes) -> None:
        given = decode_input(message)
        if not connection.is_driver:
            raise ProtocolError("input: expected one of a driver, found a spectator's")
        if given.number <= connection.input_number:
            raise ProtocolError(f"input: number: expected more than {connection.input_number}, found {given.number}")
        connection.input_number = given.number
        if self._driver_by_cav[connection.cav] == HUMAN:
            self.simulation.put_input(connection.cav, given.number, given.control)
            self._note_device(connection.cav, given.device)

    def _note_device(self, cav: str, device: InputDevice) -> None:
        """Note in the take with which device a person drives from now on, if that is new."""
        seat = self.people.seats[cav]
        if seat.noted_device != device:
            seat.device = seat.noted_device = device
            self._spawn(self._take_wheel(cav))

    async def _take_wheel(self, cav: str) -> None:
        """Let the person of a CAV drive, with the device used last."""
        with suppress(InputError, SimulationEnded):  # its drive has ended
            await self._set_driver(cav, HUMAN)

    async def _set_driver(self, cav: str, driver: str) -> None:
        """Let a person or an agent drive a CAV. Raises InputError."""
        config = {"device": self.people.seats[cav].device_name} if driver == HUMAN else {}
        await self.simulation.hand_over(cav, driver, config)
        before = self._driver_by_cav[cav]
        self._driver_by_cav[cav] = driver  # before its event comes, which may be after the next look at the clock
        if driver != before:
            name = "its person" if driver == HUMAN else driver
            self._notify(f"CAV {cav}: {name} drives now", self.people.seats[cav].connection)

    async def _receive_request(self, connection: BrowserConnection, request: messages.DriveRequest) -> None:
        if isinstance(request, messages.PingRequest):
            if request.latency_ms is not None:
                connection.latency_ms = request.latency_ms
            connection.put(PongOut(time=request.time))
            return
        if not connection.is_driver:
            raise InputError(f"{request.do}: expected a driver's link, found a spectator's")
        await self._receive_drivers_request(connection, request)

    async def _receive_drivers_request(self, connection: BrowserConnection, request: messages.DriversRequest) -> None:
        match request:
            case messages.ResumeRequest():
                await self._resume(connection)
            case messages.PauseRequest():
                await self._pause(connection)
            case messages.RewindRequest():
                await self._rewind(connection, request)
            case messages.HandOverRequest():
                await self._hand_over(connection, request)
            case messages.SayRequest():
                await self._say(connection, request)
            case messages.WhatIfRequest():
                self._start_what_if(connection, request)
            case messages.FinishRequest():
                await self._finish()
            case messages.LeaveRequest():
                self.disconnect(connection, for_good=True)
                connection.close(NORMAL, "you have left the drive")

    async def _resume(self, connection: BrowserConnection) -> None:
        if self._is_finished:
            raise InputError("resume: expected a take that goes on, found a finished one; go back to a tick to branch")
        self.people.seats[connection.cav].is_ready = True
        await self.update_clock()

    async def _pause(self, connection: BrowserConnection) -> None:
        if not self.rules.may_pause:
            raise InputError("pause: this drive cannot be paused")
        self.people.seats[connection.cav].is_ready = False
        await self.update_clock()

    async def _rewind(self, connection: BrowserConnection, request: messages.RewindRequest) -> None:
        self._check_rewind(request.do)
        async with self._lock:
            await self.simulation.branch(request.take, request.tick)
            self.people.forget_readiness()
            self._is_running = False
            self._ended.clear()  # the frames of the branch are still on their way
        place = f"{request.tick * DT:.1f} s of take {request.take}"
        self._notify(f"CAV {connection.cav}: its driver went back to {place}", connection)
        await self.update_clock()

    def _check_rewind(self, what: str) -> None:
        if not self.rules.may_rewind:
            raise InputError(f"{what}: this drive goes on without going back")

    async def _hand_over(self, connection: BrowserConnection, request: messages.HandOverRequest) -> None:
        if not self.rules.may_hand_over:
            raise InputError("hand-over: people drive this drive to its end")
        choices = (HUMAN, *self.simulation.facts.agents)
        if request.to not in choices:
            raise InputError(f"hand-over: to: {describe_unknown(request.to, choices)}")
        if request.cav != connection.cav:
            seat = self.people.seats.get(request.cav)
            if request.to == HUMAN or seat is None or not seat.is_deserted:
                found = f"found {request.cav!r}"
                raise InputError(f"hand-over: cav: expected your own or one whose driver has not come back, {found}")
        await self._set_driver(request.cav, request.to)
        await self.update_clock()

    async def _say(self, connection: BrowserConnection, request: messages.SayRequest) -> None:
        if not self.rules.chat:
            raise InputError("say: this drive is without chat")
        await self.simulation.say(connection.cav, request.text)

    async def _finish(self) -> None:
        async with self._lock:  # a branch that begins is another take
            if self._is_finished:
                raise InputError("finish: expected a take that goes on, found a finished one")
            await self.simulation.leave()
            assert self.frame is not None, "a take that goes on has frames"
            self._receive_frame(replace(self.frame, state=FrameState.FINISHED, extra={}))

    def _start_what_if(self, connection: BrowserConnection, request: messages.WhatIfRequest) -> None:
        self._check_rewind(request.do)
        if self._what_if is not None and not self._what_if.done():
            raise InputError("what-if: expected one at a time, found another under way")
        self._what_if = self._spawn(self._do_what_if(connection, request))

    async def _do_what_if(self, connection: BrowserConnection, request: messages.WhatIfRequest) -> None:
        try:
            branches = await self.simulation.what_if(
                request.take, request.tick, request.agents, request.seconds, (connection.cav,)
            )
        except (InputError, SimulationEnded) as error:
            connection.put_problem(str(error))
            return
        ghosts = [ghost for branch in branches for ghost in list_ghosts(branch)]
        connection.put(GhostsOut(take=request.take, tick=request.tick, ghosts=ghosts))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)  # the loop itself holds no reference
        task.add_done_callback(self._tasks.discard)
        return task
