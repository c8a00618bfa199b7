"""DriveSession: the people of one drive, who drives which CAV, and for whom its clock waits.

The clock runs while every person's CAV has its driver there, and every driver has sent `resume`. A driver who pauses
stops it for all, until this driver resumes. One whose connection is lost stops it, too, or hands the CAV to an agent
(`SessionRules.on_disconnect`); who comes back within `patience_s` goes on where the drive stood.
"""

import asyncio
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT
from mdrive_sumo.core.suggestion import describe_unknown
from server.drive import protocol
from server.drive.access import Role, Seat
from server.drive.connection import GOING_AWAY, NORMAL, POLICY_VIOLATION, Connection
from server.drive.protocol import CavOut, GhostOut, Ghosts, Notice, Pong, ProtocolError, TakeOut, TreeOut, Welcome
from server.drive.simulation_process import SimulationEnded, SimulationProcess
from server.drive.simulation_values import (
    HUMAN,
    Behind,
    DriveState,
    Event,
    Frame,
    Ghost,
    HandedOver,
    Problem,
    TakeEnded,
    TakeStarted,
    TreeChanged,
)
from server.drive.take_tree import TakeTree

PAUSE = "pause"
"""`SessionRules.on_disconnect`: the clock waits for who is gone."""
PATIENCE_S = 60.0
"""How long a lost driver may take to come back [s]: the issue's minute."""
SILENCE_S = 3.0
"""Time without a message after which a driver counts as absent [s]; the page sends one a second at least."""
WATCH_S = 0.25
"""Interval in which silence is looked for [s]."""
MAX_SPECTATORS = 50
"""Of one drive: each costs as much as a driver to send to."""


@dataclass(frozen=True, slots=True)
class SessionRules:
    """What people may do in a drive, beside driving: conditions of a study switch some of it off."""

    on_disconnect: str = PAUSE
    """`PAUSE`, or the agent that drives on for a lost driver."""
    chat: bool = True
    v2x_view: bool = True
    """Whether people see what CAM, CPM and MCM tell."""
    may_rewind: bool = True
    """Whether people may go back, and ask what agents would have done."""
    may_hand_over: bool = True
    may_pause: bool = True
    patience_s: float = PATIENCE_S


@dataclass(slots=True)
class _Driver:
    """The person of a CAV."""

    connection: Connection | None = None
    is_ready: bool = False
    """Whether `resume` was sent, and no `pause` since."""
    was_there: bool = False
    absent_until_s: float | None = None
    """When the time to come back ends; None: no limit, or not absent."""
    stand_in: str = ""
    """The agent that drives until the lost driver is back."""


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
        self.frame: Frame | None = None
        """The last one."""
        self._clock = clock
        self._drivers = {cav: _Driver() for cav in simulation.facts.people}
        self._driver_by_cav = {cav: HUMAN if cav in self._drivers else "" for cav in simulation.facts.cavs}
        self._connections: list[Connection] = []
        self._is_running = False
        self._is_finished = False
        self._waiting: protocol.Waiting | None = None
        self._lock = asyncio.Lock()
        self._what_if: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self.ended = asyncio.Event()
        """Set when the simulation is gone."""

    # ------------------------------------------------------------------------------------------------ simulation -> all

    async def run(self) -> None:
        """Pass on what happens in the simulation until it ends; watch for drivers who fall silent."""
        watch = asyncio.create_task(self._watch())
        try:
            async for event in self.simulation.events():
                self._receive_event(event)
        finally:
            watch.cancel()
            self.ended.set()
            for connection in [*self._connections]:
                connection.close(GOING_AWAY, "the drive has ended")

    def _receive_event(self, event: Event) -> None:
        match event:
            case Frame():
                self._receive_frame(event)
            case TakeStarted():
                self._driver_by_cav.update(event.drivers)
                self._is_finished = False
                self._put_tree()
            case HandedOver():
                self._driver_by_cav[event.cav] = event.driver
                self._notify(f"{event.cav}: {_name_driver(event.driver)} drives from {event.tick * DT:.1f} s on")
                self._spawn(self._update_clock())
            case TreeChanged() | TakeEnded():
                self._put_tree()
            case Problem():
                self._broadcast(protocol.ProblemOut(text=event.text))
            case Behind():
                pass  # the frames say so: their state and factor

    def _receive_frame(self, frame: Frame) -> None:
        if frame.take != (self.frame.take if self.frame else 0):
            self._is_running = False
            self._is_finished = False
        self.frame = frame
        self._driver_by_cav.update(frame.extra.get("drivers", {}))
        if frame.state == DriveState.FINISHED and not self._is_finished:
            self._is_finished, self._is_running = True, False
            for driver in self._drivers.values():
                driver.is_ready = False
        known = self.simulation.known_extra
        for connection in self._connections:
            connection.put_frame(frame, known, self._is_shown)

    def _is_shown(self, kind: str) -> bool:
        return self.rules.chat if kind == "text" else self.rules.v2x_view

    def _put_tree(self) -> None:
        self._broadcast(TreeOut(takes=self._list_takes(), current=self.frame.take if self.frame else 1))

    def _list_takes(self) -> list[TakeOut]:
        return list_takes(self.simulation.tree, self.frame)

    def _broadcast(self, answer: protocol.Answer) -> None:
        for connection in self._connections:
            connection.put(answer)

    def _notify(self, text: str, but: Connection | None = None) -> None:
        for connection in self._connections:
            if connection is not but:
                connection.put(Notice(text=text))

    # ------------------------------------------------------------------------------------------------------------ people

    def connect(self, seat: Seat) -> Connection:
        """Return the connection of a browser that has a seat. Raises InputError if the seat is taken."""
        if self.ended.is_set():
            raise InputError("the drive has ended; start `mdrive-sumo drive --resume` to continue it")
        connection = Connection(seat, self._clock)
        if seat.role == Role.DRIVER:
            self._seat_driver(connection)
        elif sum(not one.is_driver for one in self._connections) >= MAX_SPECTATORS:
            raise InputError(f"spectators: expected at most {MAX_SPECTATORS} at a time; close another page first")
        self._connections.append(connection)
        connection.put(self._welcome(connection))
        if self.frame is not None:
            connection.put_frame(self.frame, self.simulation.known_extra, self._is_shown)
        if self._waiting is not None:
            connection.put(self._waiting)
        return connection

    def _seat_driver(self, connection: Connection) -> None:
        driver = self._drivers[connection.cav]
        before = driver.connection
        if before is not None and not before.is_closing:
            if self._clock() - before.heard_s < SILENCE_S:
                raise InputError(
                    f"{connection.cav}: expected nobody at the wheel, found a driver; one person drives a CAV, a"
                    " spectator link shows it to others"
                )
            before.close(POLICY_VIOLATION, "the driver has connected anew")
            self._connections.remove(before)
        driver.connection = connection
        if driver.was_there:
            self._notify(f"{connection.cav}: its driver is back")
        driver.was_there = True
        driver.absent_until_s = None
        self._spawn(self._welcome_back(connection.cav))

    async def _welcome_back(self, cav: str) -> None:
        driver = self._drivers[cav]
        if driver.stand_in and self._driver_by_cav[cav] == driver.stand_in and not self._is_finished:
            driver.stand_in = ""
            with suppress(InputError):  # its drive has ended meanwhile
                await self.simulation.hand_over(cav, HUMAN)
        driver.stand_in = ""
        await self._update_clock()

    def disconnect(self, connection: Connection, *, for_good: bool = False) -> None:
        """Forget a browser. for_good: without time to come back."""
        if connection in self._connections:
            self._connections.remove(connection)
        driver = self._drivers.get(connection.cav)
        if not connection.is_driver or driver is None or driver.connection is not connection:
            return
        driver.connection = None
        driver.absent_until_s = self._clock() + (0.0 if for_good else self.rules.patience_s)
        if not self.ended.is_set():
            self._notify(f"{connection.cav}: its driver is gone")
            self._spawn(self._replace_driver(connection.cav))

    async def _replace_driver(self, cav: str) -> None:
        """Let an agent drive on if the rules say so, and look whom the clock waits for."""
        driver, agent = self._drivers[cav], self.rules.on_disconnect
        if agent != PAUSE and self._driver_by_cav[cav] == HUMAN and not self._is_finished:
            driver.stand_in = agent
            with suppress(InputError):  # its drive has ended
                await self.simulation.hand_over(cav, agent)
        await self._update_clock()

    async def _watch(self) -> None:
        """Stop the clock for drivers who fall silent though their connections stand; end the time to come back."""
        while True:
            await asyncio.sleep(WATCH_S)
            await self._update_clock()

    def _is_present(self, driver: _Driver) -> bool:
        return driver.connection is not None and self._clock() - driver.connection.heard_s < SILENCE_S

    def _list_waits(self) -> Iterator[tuple[str, _Driver]]:
        """Yield for whom the clock waits: persons at the wheel who are absent, anybody there who is not ready."""
        for cav, driver in self._drivers.items():
            drives = self._driver_by_cav[cav] == HUMAN
            if (drives and not (self._is_present(driver) and driver.is_ready)) or (
                driver.connection is not None and not driver.is_ready
            ):
                yield cav, driver

    async def _update_clock(self) -> None:
        """Stop or start the clock as the people are there and ready, and tell them for whom it waits."""
        async with self._lock:
            await self._drop_absent()
            waits = dict(self._list_waits())
            should_run = not waits and not self._is_finished and self.frame is not None
            if should_run != self._is_running and not self.ended.is_set():
                try:
                    await (self.simulation.resume() if should_run else self.simulation.pause())
                    self._is_running = should_run
                except InputError as error:
                    self._broadcast(protocol.ProblemOut(text=str(error)))
                except SimulationEnded:
                    return
            self._put_waiting(waits)

    async def _drop_absent(self) -> None:
        """End the time to come back: who is gone must press start again, and the take is left if nobody is there."""
        now_s = self._clock()
        for cav, driver in self._drivers.items():
            if driver.absent_until_s is None or now_s < driver.absent_until_s:
                continue
            driver.absent_until_s = None
            driver.is_ready = False
            driver.stand_in = ""
            self._notify(f"{cav}: its driver has not come back; another driver may hand it over to an agent")

    def _put_waiting(self, waits: dict[str, _Driver]) -> None:
        absent = [cav for cav, driver in waits.items() if not self._is_present(driver)]
        limits = [driver.absent_until_s for driver in waits.values() if driver.absent_until_s is not None]
        seconds = max(0.0, round(min(limits) - self._clock())) if limits else None
        waiting = protocol.Waiting(waits_for=[*waits], absent=absent, seconds=seconds)
        if waiting != self._waiting:
            self._waiting = waiting
            self._broadcast(waiting)

    def _welcome(self, connection: Connection) -> Welcome:
        facts = self.simulation.facts
        cav = connection.cav or None
        shown = cav or facts.cavs[0]
        return Welcome(
            role="driver" if connection.is_driver else "spectator",
            cav=cav,
            scenario=facts.scenario,
            description=facts.description,
            origin=facts.origin,
            route=facts.routes[shown],
            routes=dict(facts.routes),
            speed_limits=facts.speed_limits[shown],
            room=facts.room[shown],
            vehicle=dict(facts.vehicle),
            pseudonyms=dict(facts.pseudonyms),
            tick_s=facts.tick_s,
            most_ticks=max(facts.time_limit_ticks.values()),
            agents=list(facts.agents),
            cavs=[
                CavOut(id=one, driver=self._driver_by_cav[one], is_connected=self._is_there(one)) for one in facts.cavs
            ],
            weather=facts.weather,
            v2x_view=self.rules.v2x_view,
            chat=self.rules.chat,
            may_rewind=self.rules.may_rewind,
            takes=self._list_takes(),
        )

    def _is_there(self, cav: str) -> bool:
        return cav in self._drivers and self._drivers[cav].connection is not None

    # ----------------------------------------------------------------------------------------------- people -> simulation

    async def receive(self, connection: Connection, message: bytes | str) -> None:
        """Do what a browser asks for; what cannot be done costs one sentence to it."""
        if not connection.allow(message):
            return
        try:
            if isinstance(message, bytes):
                self._receive_input(connection, message)
            else:
                await self._receive_request(connection, protocol.decode_request(message))
        except InputError as error:
            connection.put_problem(str(error))
        except SimulationEnded as error:
            connection.put_problem(str(error))

    def _receive_input(self, connection: Connection, message: bytes) -> None:
        given = protocol.decode_input(message)
        if not connection.is_driver:
            raise ProtocolError("input: expected one of a driver, found a spectator's")
        if given.number <= connection.input_number:
            raise ProtocolError(f"input: number: expected more than {connection.input_number}, found {given.number}")
        connection.input_number = given.number
        if self._driver_by_cav[connection.cav] == HUMAN:
            self.simulation.put_input(connection.cav, given.number, given.control)

    async def _receive_request(self, connection: Connection, request: protocol.Request) -> None:
        if isinstance(request, protocol.Ping):
            connection.latency_ms = request.latency_ms if request.latency_ms is not None else connection.latency_ms
            connection.put(Pong(time=request.time))
            return
        if not connection.is_driver:
            raise InputError(f"{request.do}: expected a driver's link, found a spectator's")
        match request:
            case protocol.Resume():
                await self._resume(connection)
            case protocol.Pause():
                await self._pause(connection)
            case protocol.Rewind():
                await self._rewind(connection, request.take, request.tick)
            case protocol.HandOver():
                await self._hand_over(connection, request.cav, request.to)
            case protocol.Say():
                await self._say(connection, request.text)
            case protocol.WhatIf():
                self._start_what_if(connection, request)
            case protocol.Finish():
                await self._finish()
            case protocol.Leave():
                self.disconnect(connection, for_good=True)
                connection.close(NORMAL, "you have left the drive")

    async def _resume(self, connection: Connection) -> None:
        if self._is_finished:
            raise InputError("resume: expected a take that goes on, found a finished one; go back to a tick to branch")
        self._drivers[connection.cav].is_ready = True
        await self._update_clock()

    async def _pause(self, connection: Connection) -> None:
        if not self.rules.may_pause:
            raise InputError("pause: this drive cannot be paused")
        self._drivers[connection.cav].is_ready = False
        await self._update_clock()

    async def _rewind(self, connection: Connection, take: int, tick: int) -> None:
        self._check_rewind("rewind")
        async with self._lock:
            await self.simulation.branch(take, tick)
            for driver in self._drivers.values():
                driver.is_ready = False
            self._is_running = False
        self._notify(f"{connection.cav}: its driver went back to {tick * DT:.1f} s of take {take}", connection)
        await self._update_clock()

    def _check_rewind(self, what: str) -> None:
        if not self.rules.may_rewind:
            raise InputError(f"{what}: this drive goes on without going back")

    async def _hand_over(self, connection: Connection, cav: str, to: str) -> None:
        if not self.rules.may_hand_over:
            raise InputError("hand-over: people drive this drive to its end")
        choices = (HUMAN, *self.simulation.facts.agents)
        if to not in choices:
            raise InputError(f"hand-over: to: {describe_unknown(to, choices)}")
        if cav != connection.cav:
            self._check_deserted(cav, to)
        await self.simulation.hand_over(cav, to)

    def _check_deserted(self, cav: str, to: str) -> None:
        """Raise InputError unless a driver may hand over another CAV: to an agent, if its driver has not come back."""
        driver = self._drivers.get(cav)
        is_deserted = driver is not None and driver.connection is None and driver.absent_until_s is None
        if to == HUMAN or not is_deserted:
            raise InputError(f"hand-over: cav: expected your own or one whose driver has not come back, found {cav!r}")

    async def _say(self, connection: Connection, text: str) -> None:
        if not self.rules.chat:
            raise InputError("say: this drive is without chat")
        await self.simulation.say(connection.cav, text)

    async def _finish(self) -> None:
        if self._is_finished:
            raise InputError("finish: expected a take that goes on, found a finished one")
        await self.simulation.leave()

    def _start_what_if(self, connection: Connection, request: protocol.WhatIf) -> None:
        self._check_rewind("what-if")
        if self._what_if is not None and not self._what_if.done():
            raise InputError("what-if: expected one at a time, found another under way")
        self.simulation.tree.find(request.take)
        self._what_if = self._spawn(self._do_what_if(connection, request))

    async def _do_what_if(self, connection: Connection, request: protocol.WhatIf) -> None:
        try:
            ghosts = await self.simulation.what_if(
                request.take, request.tick, request.agents, request.seconds, (connection.cav,)
            )
        except (InputError, SimulationEnded) as error:
            connection.put_problem(str(error))
            return
        shown = [one for ghost in ghosts for one in list_ghosts(ghost)]
        connection.put(Ghosts(take=request.take, tick=request.tick, ghosts=shown))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def close(self) -> None:
        """Close all connections, leave the live take and end the simulation."""
        for connection in [*self._connections]:
            connection.close(GOING_AWAY, "the server ends; the drive can be continued with --resume")
        await self.simulation.close()


def list_takes(tree: TakeTree, frame: Frame | None) -> list[TakeOut]:
    """Return the takes as the page shows them. frame: the last of the live take, which tells how far that has come."""
    return [
        TakeOut(
            number=take.number,
            parent=take.parent,
            tick=take.tick,
            drivers=dict(take.drivers),
            status=str(take.status),
            end_tick=_find_end(take.number, take.end_tick, take.left_tick, take.tick, frame),
            score=take.score,
            ds=dict(take.ds),
            folder=str(tree.find_folder(take.number).relative_to(tree.folder)),
        )
        for _, take in sorted(tree.takes.items())
    ]


def _find_end(number: int, end: int | None, left: int | None, begin: int, frame: Frame | None) -> int:
    if end is not None:
        return end
    if frame is not None and frame.take == number:
        return max(begin, frame.tick)
    return begin if left is None else left


def list_ghosts(ghost: Ghost) -> list[GhostOut]:
    """Return a what-if branch as one ghost for each CAV."""
    return [
        GhostOut(
            agent=ghost.agent,
            cav=cav,
            poses=[(round(x, 2), round(y, 2), round(yaw, 3)) for x, y, yaw, _ in track],
            ending=ghost.endings.get(cav),
        )
        for cav, track in ghost.tracks.items()
    ]


def _name_driver(driver: str) -> str:
    return "its person" if driver == HUMAN else driver
