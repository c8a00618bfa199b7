"""SimulationProcess: the server's asyncio client of the process that simulates a drive.

    process = SimulationProcess()
    await process.open(DriveSetup("i11_ins_sl_town", Path("runs/drive-..."), people=("ego_0",)))
    async for event in process.events():  # DriveFrame, TakeStarted, TakeEnded, HandedOver, Behind, ...
        ...

The process owns the clock of the drive. A take begins paused; `resume` starts it. It runs at 20 ticks per second of
real time and never skips one: where the machine cannot keep up, time slows down and `Behind` says so. Each tick uses
one input per CAV that a person drives, in the order of their numbers (`put_input`).

All methods raise InputError with one sentence for a call that cannot be done, and `SimulationEnded` once the process is
gone. Nothing is lost then: `open` with the same folder continues the drive.
"""

import asyncio
import os
import pickle
import signal
import socket
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from mdrive_sumo.contract import Control, Reply, ReplyError, check_reply
from mdrive_sumo.core.errors import InputError, MdriveError
from mdrive_sumo.core.posix import check_posix
from server.drive.message_socket import LENGTH, MAX_MESSAGE_BYTES
from server.drive.protocol import MAX_AGENTS, MAX_WHAT_IF_S
from server.drive.simulation_values import (
    Behind,
    CallAnswer,
    DriveCall,
    DriveFacts,
    DriveFrame,
    DriveProblem,
    DriveSetup,
    Event,
    HandedOver,
    PersonInput,
    TakeEnded,
    TakeStarted,
    TreeChanged,
    WhatIfBranch,
)
from server.drive.take_tree import Take, TakeStatus, TakeTree

__all__ = [
    "Behind", "DriveFacts", "DriveSetup", "Event", "DriveFrame", "WhatIfBranch", "HandedOver", "DriveProblem",
    "SimulationEnded", "SimulationProcess", "Take", "TakeEnded", "TakeStarted", "TakeStatus", "TakeTree", "TreeChanged",
]  # fmt: skip

WORKER_MODULE = "server.drive.worker"
END_LIMIT_S = 5.0
"""How long the process may take to end after its connection is closed [s], before it is killed."""
PING_EVERY_S = 5.0
"""Time between two questions whether the process still answers [s]."""
PING_LIMIT_S, PING_TRIES = 10.0, 2
"""It hangs if it does not answer for so long [s], so many times: then it is ended, as if it had crashed. It simulates
nothing itself, and answers within a tick."""


class SimulationEnded(MdriveError):
    """The simulation process is gone; the drive continues from its folder with `open`."""


class SimulationProcess:
    """One drive: a process with its takes, checkpoints and background work. Use it in one event loop."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None
        self._watching: asyncio.Task[None] | None = None
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._events: asyncio.Queue[Event | None] = asyncio.Queue()
        self._calls = 0
        self._is_closing = False
        self._facts: DriveFacts | None = None
        self._scene = b""
        self._tree: TakeTree | None = None
        self._known = _KnownExtra()

    async def open(self, setup: DriveSetup) -> None:
        """Start the process, load the scenario and begin a take, paused in its first tick.

        In a new folder that is take 1: from tick 0, or from `from_tick` of the run that is entered. In the folder of an
        earlier drive, also of one whose server was killed, the takes that were not finished are finished in the
        background as left, and a new take continues the latest of them in its last tick; if all takes are finished, a
        new one begins in tick 0. Raises InputError for an unknown scenario, suite, run, tick, CAV or agent, a folder of
        another drive, or a folder that cannot be written.
        """
        check_posix("a drive")
        ours, theirs = socket.socketpair()
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # forks copy one thread only
        with theirs:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", WORKER_MODULE, stdin=theirs.fileno(), env=environment, start_new_session=True
            )
        ours.setblocking(False)
        reader, self._writer = await asyncio.open_connection(sock=ours, limit=2**20)
        self._events, self._is_closing = asyncio.Queue(), False
        self._reading = asyncio.create_task(self._read(reader))
        try:
            self._facts, self._scene = await self._call("open", setup)
        except BaseException:
            await self._end()
            raise
        self._watching = asyncio.create_task(self._watch())

    async def _watch(self) -> None:
        """End the process if it no longer answers; what follows is that of a process that has ended."""
        failed = 0
        while failed < PING_TRIES:
            await asyncio.sleep(0.0 if failed else PING_EVERY_S)
            try:
                await asyncio.wait_for(self._call("ping"), PING_LIMIT_S)
                failed = 0
            except TimeoutError:
                failed += 1
            except SimulationEnded:
                return
        self._kill()

    def _kill(self) -> None:
        """Kill all processes of the drive: they are a group of their own."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    @property
    def is_open(self) -> bool:
        """Whether the process runs and has a drive."""
        return self._facts is not None and self._reading is not None and not self._reading.done()

    @property
    def facts(self) -> DriveFacts:
        """What does not change during the drive."""
        assert self._facts is not None, "expected open() before anything else"
        return self._facts

    @property
    def scene(self) -> bytes:
        """The packed 3-D scene, see `report.scene_3d.pack_scene`."""
        return self._scene

    @property
    def tree(self) -> TakeTree:
        """The takes, as of the last event."""
        assert self._tree is not None, "expected open() before anything else"
        return self._tree

    @property
    def known_extra(self) -> Mapping[str, Any]:
        """The `extra` of a frame for a page that joins now: all names, signals, endings and drivers."""
        return self._known.to_extra()

    async def events(self) -> AsyncIterator[Event]:
        """Yield what happens, in order, until the process ends. One consumer only."""
        while (event := await self._events.get()) is not None:
            yield event

    def put_input(self, cav: str, number: int, control: Control) -> None:
        """Send a person's numbered input; it does not wait.

        Numbers ascend; number 1 begins a new sequence, as after a lost connection. A tick uses the oldest input that
        waits; without one it repeats the last one; of more than three that wait, the newest two are kept. An input for
        a CAV that no person drives is dropped. Raises InputError for NaN, a value outside its range, or no such CAV.
        """
        if cav not in self.facts.cavs:
            raise InputError(f"input: expected a CAV ({', '.join(self.facts.cavs)}), found {cav!r:.40}")
        if type(number) is not int or not 1 <= number < 2**32:
            raise InputError(f"input: expected a number from 1 to {2**32 - 1}, found {number!r:.40}")
        try:
            checked = check_reply(Reply(control=control), frozenset()).control
        except ReplyError as error:
            raise InputError(f"input: {error}") from None
        assert checked is not None, "a reply with a control"
        self._send(PersonInput(cav, number, checked))

    async def pause(self) -> None:
        """Stop the clock after the tick that is computed; a second call is void."""
        await self._call("pause")

    async def resume(self) -> None:
        """Let the clock run. Inputs that arrived before are dropped but for the newest of each CAV.

        Raises InputError if the live take has ended.
        """
        await self._call("resume")

    async def branch(self, take: int, tick: int) -> int:
        """Begin a new take that is the same as `take` up to `tick`; return its number. It is paused in that tick.

        The live take is left: it is finished in the background as if its people had gone. Raises InputError for a take
        or tick that does not exist; the live take is then paused.
        """
        return await self._call("branch", take, tick)

    async def hand_over(self, cav: str, driver: str, config: Mapping[str, Any] | None = None) -> None:
        """Give a CAV of the live take to a built-in agent, or to a person (`human`), from the next tick on.

        Raises InputError for an unknown CAV or agent, and for a CAV that has ended.
        """
        await self._call("hand_over", cav, driver, dict(config or {}))

    async def say(self, cav: str, text: str) -> None:
        """Send a text from a CAV to the others over the V2X channel in the next tick. Raises InputError if too long."""
        await self._call("say", cav, text)

    async def note_input(self, device: str, latency_ms: float) -> None:
        """Note with what people drive and the median latency of their inputs [ms], for the provenance of takes."""
        await self._call("note", device, latency_ms)

    async def what_if(
        self, take: int, tick: int, agents: Sequence[str], seconds: float = 5.0, cavs: Sequence[str] = ()
    ) -> list[WhatIfBranch]:
        """Return what each agent would have done from a tick on, for so many seconds of simulated time.

        agents: 1 to `MAX_AGENTS` built-in agents, each driving a branch of its own. cavs: the CAVs that it takes
        over; none named: those that people drive in that tick, or all of the drive's people. It runs beside the live
        take with low priority. Raises InputError.
        """
        if not 1 <= len(agents) <= MAX_AGENTS:
            raise InputError(f"what-if: expected 1 to {MAX_AGENTS} agents, found {len(agents)}")
        if not 0 < seconds <= MAX_WHAT_IF_S:  # NaN fails too
            raise InputError(f"what-if: expected more than 0 and at most {MAX_WHAT_IF_S:g} seconds, found {seconds!r}")
        return await self._call("what_if", take, tick, tuple(agents), float(seconds), tuple(cavs))

    async def load_motion(self, take: int) -> bytes:
        """Return the motion of a take from tick 0 to its last tick so far, for scrubbing; see `motion.pack_motion`."""
        return await self._call("load_motion", take)

    async def leave(self) -> None:
        """Leave the live take: its people's CAVs fail with `FailureReason.LEFT` and brake; it is finished in the
        background. The process stays open for `branch`.
        """
        await self._call("leave")

    async def close(self, wait_s: float = 120.0) -> None:
        """Leave the live take, finish what was left for at most `wait_s` seconds, and end the process.

        What is not finished by then is finished when the folder is opened again. Never raises for a dead process.
        """
        if self.is_open and wait_s > 0:
            with suppress(SimulationEnded, InputError, TimeoutError):
                await asyncio.wait_for(self._call("finish"), wait_s)
        await self._end()

    async def _end(self) -> None:
        """Close the connection, at which all processes of the drive end, and wait for that."""
        self._is_closing = True
        if self._writer is not None:
            self._writer.close()
            with suppress(ConnectionError):
                await self._writer.wait_closed()
        if self._process is not None:
            try:
                await asyncio.wait_for(self._process.wait(), END_LIMIT_S)
            except TimeoutError:
                self._kill()
                await self._process.wait()
        if self._reading is not None:
            await self._reading
        if self._watching is not None:
            self._watching.cancel()
        self._process = self._writer = self._reading = self._watching = None

    def _send(self, message: object) -> None:
        if self._writer is None or self._reading is None or self._reading.done():
            raise SimulationEnded("the simulation of this drive has ended; open the drive again to continue")
        data = pickle.dumps(message)
        self._writer.write(LENGTH.pack(len(data)) + data)

    async def _call(self, name: str, *arguments: Any) -> Any:
        self._calls += 1
        number = self._calls
        future = self._answers[number] = asyncio.get_running_loop().create_future()
        try:
            self._send(DriveCall(number, name, arguments))
            return await future
        finally:
            self._answers.pop(number, None)

    async def _read(self, reader: asyncio.StreamReader) -> None:
        with suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                (length,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
                assert length <= MAX_MESSAGE_BYTES, "expected a message of the worker"
                self._receive(pickle.loads(await reader.readexactly(length)))  # our own process, no stranger's bytes
        sentence = "the simulation of this drive has ended; open the drive again to continue"
        for future in self._answers.values():
            if not future.done():
                future.set_exception(SimulationEnded(sentence))
        if not self._is_closing:
            self._events.put_nowait(DriveProblem(sentence, is_fatal=True))
        self._events.put_nowait(None)

    def _receive(self, message: Any) -> None:
        if isinstance(message, CallAnswer):
            future = self._answers.get(message.number)
            if future is not None and not future.done():
                if message.problem:
                    future.set_exception(InputError(message.problem))
                else:
                    future.set_result(message.value)
            return
        if isinstance(message, TreeChanged):
            self._tree = message.tree
        elif isinstance(message, DriveFrame):
            self._known.add(message)
        self._events.put_nowait(message)


class _KnownExtra:
    """What the frames of the live take have said so far and a newcomer must know."""

    def __init__(self) -> None:
        self._take = 0
        self._names: dict[int, Any] = {}
        self._maps: dict[str, dict[str, Any]] = {}

    def add(self, frame: DriveFrame) -> None:
        if frame.take != self._take:
            self._take, self._names, self._maps = frame.take, {}, {}
        for row in frame.extra.get("names", ()):
            self._names[row[0]] = row
        for key in ("signals", "endings", "drivers"):
            if key in frame.extra:
                self._maps.setdefault(key, {}).update(frame.extra[key])

    def to_extra(self) -> dict[str, Any]:
        return {"names": list(self._names.values()), **{key: dict(value) for key, value in self._maps.items()}}
