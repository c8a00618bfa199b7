"""The process in which a third-party agent lives: a plain child of ours, or one in a box.

Either has a socket, and runs `agents.host`, which finds its end of it and the frame folder by its arguments.
"""

import select
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from mdrive_sumo.agent_process import sandbox

HOST = "mdrive_sumo.agent_process.host"
PACKAGE = Path(__file__).parents[1]
HIDDEN = frozenset({"scenarios"})
"""Of our package, what a box does not see. Compiled code is seen: nobody has to compile it anew for every box."""
KIT, SITE, PYTHON, FRAMES = "/kit", "/site", "/python", "/frames"
"""Where a box sees our code, the environment's packages, its interpreter, and the frames; the agent is in /agent."""
AGENT_FD = 3
ENDING_S = 2.0
"""How long a process may take to end after it has closed its socket."""


class AgentProcess(Protocol):
    """A process with a socket."""

    @property
    def socket(self) -> socket.socket:
        """Our end."""
        ...

    def wait_readable(self, timeout_s: float) -> bool:
        """Waits until there is something to read, or nobody who could write; keeps what it prints flowing."""
        ...

    def describe_exit(self) -> str:
        """How a process ended that has closed its socket, e.g. "exit code 3"; it is gone afterwards."""
        ...

    def close(self) -> None:
        """Ends it."""
        ...

    def usage_record(self) -> Mapping[str, Any]:
        """Of a process that is gone: how it ended and what it used, plain values for a file."""
        ...


@dataclass(frozen=True, slots=True)
class AgentProgram:
    """What a child runs: a style of agent that `host` knows, where it is, and where its output goes."""

    locator: str
    """`module:Class`, `path.py:Class`, for the style carla `path.py`, for the style pickle "": paths of the child."""
    style: str = "agent"
    log: Path | None = None
    """File for its output; None discards it."""
    pickled: bytes = b""
    """Style pickle: the agent's class; `open_agent_connection` writes it into a file of the child."""

    def arguments(self, fd: int, frames: str) -> tuple[str, ...]:
        """The command line after the interpreter."""
        return ("-m", HOST, self.style, self.locator, str(fd), frames)


@dataclass(frozen=True, slots=True)
class AgentBox:
    """The sandbox of an agent. The content of `folder` is mounted read-only as /agent."""

    folder: Path
    python: str = "/usr/bin/python3"
    """The interpreter; the installation of one outside /usr is mounted as a whole."""
    site: Path | None = None
    """Folder with the packages of the environment, numpy and msgpack among them."""
    backend: str = "bubblewrap"
    rootfs: Path | None = None
    """Unpacked image that replaces this host's programs; `python` is then a path in it."""
    limits: sandbox.BoxLimits = field(default_factory=sandbox.BoxLimits)


class PlainAgentProcess:
    """As free as the user who started it: only the clock and the contract are enforced."""

    def __init__(self, program: AgentProgram, frames: Path) -> None:
        """Raises OSError."""
        self.socket, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, *program.arguments(theirs.fileno(), str(frames))]
            log = program.log.open("wb") if program.log is not None else None
            output = log if log is not None else subprocess.DEVNULL
            self._process = subprocess.Popen(  # awaited in close()
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, pass_fds=(theirs.fileno(),)
            )
            if log is not None:
                log.close()
        self._poller = select.poll()
        self._poller.register(self.socket, select.POLLIN)

    def wait_readable(self, timeout_s: float) -> bool:
        """See Child."""
        return bool(self._poller.poll(max(timeout_s, 0.0) * 1000))

    def describe_exit(self) -> str:
        """See Child."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=ENDING_S)
        self.close()
        return f"exit code {self._process.returncode}"

    def close(self) -> None:
        """See Child."""
        self._process.kill()
        self.socket.close()
        self._process.wait()

    def usage_record(self) -> Mapping[str, Any]:
        """See Child."""
        return {"backend": "", "exit_code": self._process.returncode}


class BoxedAgentProcess:
    """In a box of its own. Only from the main thread, see `sandbox.open_box`."""

    def __init__(self, program: AgentProgram, frames: Path, box: AgentBox) -> None:
        """Raises InputError if there is no such box here, and BoxError."""
        interpreter, shown = _locate_interpreter(box)
        spec = sandbox.BoxSpec(
            command=(interpreter, *_interpreter_options(box), *program.arguments(AGENT_FD, FRAMES)),
            readonly={box.folder: "/agent", frames: FRAMES} | shown | _list_library_mounts(box.backend),
            # A fixed hash seed: what an agent does with sets and dictionaries shall not differ from run to run.
            env={"PYTHONPATH": f"{KIT}:{SITE}" if box.site else KIT, "PYTHONHASHSEED": "0"},
            limits=box.limits,
            backend=box.backend,
            rootfs=box.rootfs,
        )
        self._backend, self._log = box.backend, program.log
        self._box = sandbox.open_box(spec)
        self._report: sandbox.BoxReport | None = None

    @property
    def socket(self) -> socket.socket:
        """See Child."""
        return self._box.socket

    def wait_readable(self, timeout_s: float) -> bool:
        """See Child."""
        return self._box.ready(max(timeout_s, 0.0))

    def describe_exit(self) -> str:
        """See Child."""
        end = time.monotonic() + ENDING_S
        while self._box.alive() and time.monotonic() < end:
            self._box.pump()
            time.sleep(0.005)
        self.close()
        report = self._report
        assert report is not None
        if report.oom_killed:
            return "out of memory"
        return f"exit code {report.exit_code if report.signal is None else -report.signal}"

    def close(self) -> None:
        """See Child. Raises BoxError if it was the box that failed."""
        if self._report is None:
            if self._log is not None:
                self._box.pump()
            self._report = self._box.close()
            if self._log is not None:
                self._log.write_bytes(self._box.log())

    def usage_record(self) -> Mapping[str, Any]:
        """See Child."""
        assert self._report is not None
        return {"backend": self._backend, **asdict(self._report)}


def _interpreter_options(box: AgentBox) -> tuple[str, ...]:
    """No packages but those of the environment, if it has some: what else a host has would change results."""
    return ("-s", "-S") if box.site else ("-s",)


def _locate_interpreter(box: AgentBox) -> tuple[str, dict[Path, str]]:
    """The interpreter's path in the box, and what must be shown for it."""
    shown = {box.site: SITE} if box.site else {}
    path = Path(box.python)
    if box.rootfs or path.resolve().is_relative_to("/usr"):
        return (box.python if box.rootfs else str(path.resolve())), shown
    path = path.resolve()
    return f"{PYTHON}/bin/{path.name}", shown | {path.parents[1]: PYTHON}


def _list_library_mounts(backend: str) -> dict[Path, str]:
    """Our own code, without the scenarios that agents are tried on. Without a box nothing can be hidden."""
    if backend == "none":
        return {PACKAGE.parent: KIT}
    return {entry: f"{KIT}/{PACKAGE.name}/{entry.name}" for entry in PACKAGE.iterdir() if entry.name not in HIDDEN}
