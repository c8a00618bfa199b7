"""A drive session over a fake simulation, with a clock that tests set. No tests in here."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from server.drive.access import Seat, SeatRole
from server.drive.browser_connection import BrowserConnection, Closing
from server.drive.drive_session import DriveSession
from server.drive.protocol import decode_frame
from server.drive.session_rules import SessionRules
from testing.drive_fakes import FakeSimulation, make_setup


class Bench:
    """A session over a fake simulation, with a clock that tests set."""

    def __init__(self, folder: Path, people: tuple[str, ...], rules: SessionRules) -> None:
        self.now_s = 100.0
        self.folder, self.people, self.rules = folder, people, rules
        self.simulation = FakeSimulation()

    async def start(self) -> None:
        await self.simulation.open(make_setup(self.folder, self.people))
        self.session = DriveSession("drive", self.simulation, self.rules, lambda: self.now_s)
        self.running = asyncio.create_task(self.session.run())
        await settle()

    async def join(self, cav: str = "") -> BrowserConnection:
        role = SeatRole.DRIVER if cav else SeatRole.SPECTATOR
        connection = self.session.connect(Seat("drive", role, cav))
        await settle()
        return connection

    async def ask(self, connection: BrowserConnection, **request: Any) -> list[Any]:
        """Send a request, and return what the browser is told then."""
        await drain(connection)
        await self.session.receive(connection, json.dumps(request))
        await settle()
        return await drain(connection)

    async def wait(self, seconds: float, *present: BrowserConnection) -> None:
        """Let time pass; those who are present are heard."""
        self.now_s += seconds
        for connection in present:
            connection.heard_s = self.now_s
        await self.session.update_clock()
        await settle()

    @property
    def clock_calls(self) -> list[str]:
        return [call[0] for call in self.simulation.calls if call[0] in ("pause", "resume")]


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


async def drain(connection: BrowserConnection) -> list[Any]:
    """What waits for a browser: messages as objects, frames as `WireFrame`s."""
    out: list[Any] = []
    while True:
        try:
            sent = await asyncio.wait_for(connection.take_next(), 0.005)
        except TimeoutError:
            return out
        if isinstance(sent, Closing):
            return [*out, sent]
        out += [decode_frame(one) if isinstance(one, bytes) else json.loads(one) for one in sent]


def problems(told: list[Any]) -> list[str]:
    return [one["text"] for one in told if isinstance(one, dict) and one["is"] == "problem"]


def drive(
    test: Callable[[Bench], Awaitable[None]], folder: Path, people: tuple[str, ...] = ("ego_0",), **rules: Any
) -> None:
    async def run() -> None:
        bench = Bench(folder, people, SessionRules(**rules))
        await bench.start()
        await test(bench)
        bench.simulation.end()
        await bench.running

    asyncio.run(run())
