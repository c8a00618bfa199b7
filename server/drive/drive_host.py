"""DriveHost: the drives of one server, their links, and their simulation processes, started anew if they end."""

import asyncio
import logging
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from server.drive.access import HostCheck, Seat, SeatRole, TokenTable
from server.drive.drive_session import DriveSession
from server.drive.session_rules import SessionRules
from server.drive.simulation_process import SimulationEnded, SimulationProcess
from server.drive.simulation_values import DriveSetup

LOG = logging.getLogger("mdrive.drive")
MAX_RESTARTS = 3
"""Times that a simulation process is started anew: what ends it again and again will not stop doing so."""
CLOSE_S = 120.0
"""Time for takes that were left to be finished at the end [s]: what takes longer is finished with `--resume`."""
MAX_DRIVES = 64
"""Drives of one server at a time: each is a process of about 200 MB."""


@dataclass(frozen=True, slots=True)
class DriveLink:
    """A link to give to a person."""

    role: SeatRole
    cav: str
    """CAV of a driver; "" for others."""
    path: str
    """With its token, from the server's root."""


def _log_end(name: str, sentence: str) -> None:
    LOG.error("drive %s: %s", name, sentence)


class DriveHost:
    """The drives of one server. All methods run in one event loop."""

    def __init__(
        self, names: Iterable[str] = (), make_simulation: Callable[[], SimulationProcess] = SimulationProcess
    ) -> None:
        """names: host names of this server, besides those of this machine alone and numeric addresses."""
        self.tokens = TokenTable()
        self.hosts = HostCheck(names)
        self.host_token = self.tokens.issue(Seat("", SeatRole.HOST))
        """Opens the page with all links."""
        self.on_end: Callable[[str, str], None] = _log_end
        """Called with a drive that has ended for good without `close_drive`, and a sentence why."""
        self._make_simulation = make_simulation
        self._sessions: dict[str, DriveSession] = {}
        self._links: dict[str, list[DriveLink]] = {}
        self._running: dict[str, asyncio.Task[None]] = {}
        self._closing: set[str] = set()

    async def open_drive(self, name: str, setup: DriveSetup, rules: SessionRules | None = None) -> DriveSession:
        """Start a simulation process and return its drive. Raises InputError for a setup that cannot be driven."""
        if name in self._sessions:
            raise InputError(f"drive {name!r}: expected a new name, found one that is driven")
        if len(self._sessions) >= MAX_DRIVES:
            raise InputError(f"drives: expected at most {MAX_DRIVES} at a time, found another one; close one first")
        session = await self._open(name, setup, rules)
        cavs = session.simulation.facts.people
        drivers = [self._make_link(name, SeatRole.DRIVER, cav, f"/drive/{cav}") for cav in cavs]
        self._links[name] = [*drivers, self._make_link(name, SeatRole.SPECTATOR, "", "/watch")]
        self._running[name] = asyncio.create_task(self._run(name, setup, rules))
        return session

    async def _open(self, name: str, setup: DriveSetup, rules: SessionRules | None) -> DriveSession:
        simulation = self._make_simulation()
        await simulation.open(setup)
        session = self._sessions[name] = DriveSession(name, simulation, rules)
        return session

    def _make_link(self, name: str, role: SeatRole, cav: str, path: str) -> DriveLink:
        return DriveLink(role, cav, f"{path}?token={self.tokens.issue(Seat(name, role, cav))}")

    async def _run(self, name: str, setup: DriveSetup, rules: SessionRules | None) -> None:
        """Run a drive; if its simulation process ends by itself, continue from the drive's folder."""
        for restart in range(MAX_RESTARTS + 1):
            await self._sessions[name].run()
            if name in self._closing:
                return
            await self._sessions[name].simulation.close(wait_s=0.0)
            if restart == MAX_RESTARTS:
                break
            LOG.warning("drive %s: its simulation has ended; it is started anew and continues", name)
            try:
                await self._open(name, replace(setup, from_run=None, from_tick=0), rules)
            except (InputError, SimulationEnded, OSError) as error:
                self.on_end(name, f"{error}")
                return
        self.on_end(name, f"the simulation has ended {MAX_RESTARTS + 1} times")

    def find_session(self, name: str) -> DriveSession | None:
        """Return a drive; None if there is none of that name."""
        return self._sessions.get(name)

    def list_drives(self) -> list[str]:
        """Return the names of all drives."""
        return [*self._sessions]

    def list_links(self, name: str) -> list[DriveLink]:
        """Return the links of a drive: one for each driver, one for all spectators."""
        return list(self._links[name])

    async def close_drive(self, name: str, wait_s: float = CLOSE_S) -> None:
        """End a drive and its links; its folder can be opened again. wait_s: for takes that are being finished [s]."""
        self._closing.add(name)
        session = self._sessions.get(name)
        if session is None:
            return
        await session.close(wait_s)
        with suppress(asyncio.CancelledError):
            await self._running[name]
        self.tokens.revoke(name)
        del self._sessions[name], self._links[name], self._running[name]
        self._closing.discard(name)

    async def close(self, wait_s: float = CLOSE_S) -> None:
        """End all drives. wait_s: for takes that are being finished [s]."""
        await asyncio.gather(*(self.close_drive(name, wait_s) for name in self.list_drives()))


def make_drive_folder(out: Path | None, scenario: str, seed: int) -> Path:
    """Return the folder of a new drive: `out`, else the first free `runs/drive-SCENARIO[-seedN]-K`."""
    if out is not None:
        return out
    stem = f"drive-{scenario}" + (f"-seed{seed}" if seed else "")
    number = 1
    while (folder := Path("runs") / f"{stem}-{number}").exists():
        number += 1
    return folder
