"""A drive without pages: the simulation process with a program at the wheel. No tests in here."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from mdrive_sumo.contract import Control
from server.drive.simulation_process import (
    DriveFrame,
    DriveProblem,
    DriveSetup,
    Event,
    SimulationProcess,
    TakeEnded,
    TreeChanged,
)
from testing.takes import invoke

T = TypeVar("T")
SCENARIO = "i01_ins_c_main_street_right"
LIMIT_S = 20.0
"""After so long a test that waits for an event fails."""


class DriveSession:
    """A simulation process and everything that it has said. Its people press what `pedals` says in every tick."""

    def __init__(
        self, pedals: Callable[[int], Control] = lambda tick: Control(0.4, 0.0, 0.0), limit_s: float = LIMIT_S
    ) -> None:
        """limit_s: of each waiting."""
        self._limit_s = limit_s
        self.process = SimulationProcess()
        self.events: list[Event] = []
        self.frames: list[DriveFrame] = []
        self.frame_times: list[float] = []
        """When each of them came [s]."""
        self._pedals = pedals
        self._changed = asyncio.Condition()
        self._listening: asyncio.Task[None] | None = None
        self._number = 0

    async def open(self, setup: DriveSetup) -> None:
        await self.process.open(setup)
        self._listening = asyncio.create_task(self._listen())
        await self.wait_for(lambda: self.frames)

    async def _listen(self) -> None:
        async for event in self.process.events():
            async with self._changed:
                if isinstance(event, DriveFrame):
                    self.frames.append(event)
                    self.frame_times.append(time.monotonic())
                    self._number += 1
                    with suppress(Exception):
                        for cav in self.process.facts.people:
                            self.process.put_input(cav, self._number, self._pedals(event.tick))
                elif not isinstance(event, TreeChanged):
                    self.events.append(event)
                self._changed.notify_all()

    async def wait_for(self, is_true: Callable[[], object]) -> None:
        async with self._changed, asyncio.timeout(self._limit_s):
            await self._changed.wait_for(lambda: bool(is_true()))

    async def drive_to(self, tick: int) -> None:
        """Let the clock run up to a tick of the live take, or its end, and pause."""
        live = max(self.process.tree.takes)
        await self.process.resume()
        await self.wait_for(
            lambda: (
                any(event.take == live for event in self.select(TakeEnded))
                or (self.frames[-1].take == live and self.tick >= tick)
            )
        )
        await self.process.pause()

    async def drive_on(self, ticks: int) -> None:
        """Wait until the running clock has gone on by so many ticks."""
        tick = self.tick + ticks
        await self.wait_for(lambda: self.tick >= tick)

    async def wait_until_ended(self, *takes: int) -> None:
        await self.wait_for(lambda: {*takes} <= {event.take for event in self.select(TakeEnded)})

    def select(self, kind: type[T]) -> list[T]:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def problems(self) -> list[str]:
        return [event.text for event in self.select(DriveProblem)]

    @property
    def tick(self) -> int:
        return self.frames[-1].tick

    @property
    def group(self) -> int:
        """The process group of the drive."""
        process = self.process._process
        assert process is not None
        return process.pid

    async def close(self, wait_s: float = 60.0) -> None:
        await self.process.close(wait_s)
        if self._listening is not None:
            await self._listening


def run_drive(drive: Callable[[DriveSession], Awaitable[None]]) -> None:
    """Run a test that drives; its processes end with it, whatever happens."""

    async def run() -> None:
        session = DriveSession()
        try:
            await drive(session)
        finally:
            await session.close(0.0)

    asyncio.run(run())


def list_group(group: int) -> dict[int, str]:
    """The processes of a group, by id, with their states: Z is a zombie."""
    found: dict[int, str] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            pid, _, rest = path.read_text().partition(" (")
            fields = rest.rpartition(") ")[2].split()
            if int(fields[2]) == group:
                found[int(pid)] = fields[0]
    return found


def make_setup(folder: Path, suite: Path, /, **values: object) -> DriveSetup:
    settings = {"people": ("0",), "speed_up": 10.0, "suite": str(suite), **values}
    return DriveSetup(SCENARIO, folder, **settings)  # pyright: ignore[reportArgumentType]


def verify(run: Path) -> None:
    ended = invoke("verify", run, "--workers", 1)
    assert ended.exit_code == 0, ended.output
