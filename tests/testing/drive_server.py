"""The server of `drive` in a thread of the test, over real sockets of this machine. No tests in here."""

import asyncio
import socket
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import uvicorn

from server.cli.drive_command import make_config
from server.drive.drive_app import create_drive_app
from server.drive.drive_host import DriveHost
from server.drive.drive_session import DriveSession
from server.drive.session_rules import SessionRules
from server.drive.simulation_process import SimulationProcess
from server.drive.simulation_values import DriveSetup
from testing.drive_fakes import FakeSimulation, make_setup

START_S = 60.0
"""Time for a server to start on a busy machine [s]."""


@dataclass
class DriveServer:
    """What tests know of a running server."""

    loop: asyncio.AbstractEventLoop
    host: DriveHost
    port: int
    name: str = "drive"

    def do(self, work: Any) -> Any:
        """Run a coroutine in the server's loop and return its result."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(START_S)

    def call(self, function: Callable[[], Any]) -> Any:
        """Call a function in the server's loop."""

        async def work() -> Any:
            return function()

        return self.do(work())

    @property
    def session(self) -> DriveSession:
        session = self.host.find_session(self.name)
        assert session is not None
        return session

    @property
    def simulation(self) -> FakeSimulation:
        assert isinstance(self.session.simulation, FakeSimulation)
        return self.session.simulation

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def link(self, cav: str = "") -> str:
        """The path of a driver's link, of the spectators' for ""."""
        return next(link.path for link in self.host.list_links(self.name) if link.cav == cav)

    def token(self, cav: str = "") -> str:
        return self.link(cav).partition("token=")[2]


@contextmanager
def serve_drive(
    setup: DriveSetup | None = None,
    *,
    folder: Path = Path(),
    people: Sequence[str] = ("ego_0",),
    rules: SessionRules | None = None,
    make_simulation: Callable[[], SimulationProcess] = FakeSimulation,
    names: Sequence[str] = (),
    others: Mapping[str, DriveSetup] = MappingProxyType({}),
) -> Generator[DriveServer]:
    """Serve one drive, by default over a fake simulation. others: further drives, by name."""
    ready = threading.Event()
    found: dict[str, Any] = {}

    async def work() -> None:
        host = DriveHost(names, make_simulation)
        with socket.create_server(("127.0.0.1", 0)) as listener:
            try:
                await host.open_drive("drive", setup or make_setup(folder, people), rules)
                for name, other in others.items():
                    await host.open_drive(name, other, rules)
                server = uvicorn.Server(make_config(create_drive_app(host)))
                found["server"] = server
                found["drive"] = DriveServer(asyncio.get_running_loop(), host, listener.getsockname()[1])
                ready.set()
                await server.serve(sockets=[listener])
            finally:
                await host.close(wait_s=0.0)

    def run() -> None:
        try:
            asyncio.run(work())
        except BaseException as error:  # noqa: BLE001 (raised in the test's thread)
            found["error"] = error
        finally:
            ready.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(START_S)
    if "error" in found:
        raise found["error"]
    try:
        yield found["drive"]
    finally:
        found["server"].should_exit = True
        thread.join(START_S)
    if "error" in found:
        raise found["error"]
