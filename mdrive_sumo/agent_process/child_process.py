"""The process of a third-party agent: a plain child process, or a boxed one.

Either has a socket and runs `host`, which gets its end of the socket and the frame folder as arguments.
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
from mdrive_sumo.core.output_files import create_anew, write_bytes

HOST = "mdrive_sumo.agent_process.host"
PACKAGE = Path(__file__).parents[1]
HIDDEN = frozenset({"scenarios"})
"""Parts of our package that are not mounted in a box. Compiled code is mounted, so it is compiled only once."""
KIT, SITE, PYTHON, FRAMES, AGENT_FOLDER = "/kit", "/site", "/python", "/frames", "/agent"
"""Paths in a box of our code, the environment's packages, its interpreter, the frames, and the agent."""
AGENT_FD = 3
"""The first after the standard ones, as `sandbox.BoxSpec` promises."""
ENDING_S = 2.0
"""How long a process may take to end after it has closed its socket [s]."""


class AgentProcess(Protocol):
    """An agent's process with a socket."""

    @property
    def socket(self) -> socket.socket:
        """Our end."""
        ...

    @property
    def log_fd(self) -> int:
        """The pipe with the output of the process, which must be drained; -1 if there is none."""
        ...

    def wait_readable(self, timeout_s: float) -> bool:
        """Wait until the socket is readable or closed, and return whether it is; drains the output of the process."""
        ...

    def describe_exit(self) -> str:
        """Return how a process ended that has closed its socket, e.g. "exit code 3"; it is gone afterwards."""
        ...

    def close(self) -> None:
        """End the process."""
        ...

    def usage_record(self) -> Mapping[str, Any]:
        """Return how an ended process ended and its resources, as plain values for a file."""
        ...


@dataclass(frozen=True, slots=True)
class AgentProgram:
    """The program of an agent's process: its style, its place, and the file for its output."""

    locator: str
    """`module:Class`, `path.py:Class`, for the styles carla and carla-single `path.py`, for the style pickle "".

    Paths are those of the child.
    """
    style: str = "agent"
    log: Path | None = None
    """File for its output; None discards it."""
    pickled: bytes = b""
    """Style pickle: the agent's class; `open_agent_connection` writes it into a file of the child."""

    def arguments(self, fd: int, frames: str) -> tuple[str, ...]:
        """Return the command line after the interpreter."""
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
    hidden: tuple[Path, ...] = ()
    """Folders whose content the agent must not see, wherever they lie in what the box shows."""
    copies: Path | None = None
    """Folder for copies of all files that the box shows, so that no two boxes share one; None: boxes share them."""
    owns_signals: bool = False
    """Whether a signal that may have come from outside is the agent's failure: in a run that repeats another one
    because of such a signal."""


class PlainAgentProcess:
    """A child process with the rights of the user: only the clock and the contract are enforced."""

    log_fd = -1

    def __init__(self, program: AgentProgram, frames: Path) -> None:
        """Raises OSError."""
        self.socket, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, *program.arguments(theirs.fileno(), str(frames))]
            log = create_anew(program.log) if program.log is not None else None
            output = log if log is not None else subprocess.DEVNULL
            self._process = subprocess.Popen(  # awaited in close()
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, pass_fds=(theirs.fileno(),)
            )
            if log is not None:
                log.close()
        self._poller = select.poll()
        self._poller.register(self.socket, select.POLLIN)

    def wait_readable(self, timeout_s: float) -> bool:
        """See AgentProcess."""
        return bool(self._poller.poll(max(timeout_s, 0.0) * 1000))

    def describe_exit(self) -> str:
        """See AgentProcess."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=ENDING_S)
        self.close()
        return f"exit code {self._process.returncode}"

    def close(self) -> None:
        """See AgentProcess."""
        self._process.kill()
        self.socket.close()
        self._process.wait()

    def usage_record(self) -> Mapping[str, Any]:
        """See AgentProcess."""
        return {"backend": "", "exit_code": self._process.returncode}


class BoxedAgentProcess:
    """A process in a box of its own. Only from the main thread, see `sandbox.open_box`."""

    def __init__(self, program: AgentProgram, frames: Path, box: AgentBox) -> None:
        """Raises InputError if there is no such box here, and BoxError."""
        interpreter, shown = _locate_interpreter(box)
        spec = sandbox.BoxSpec(
            command=(interpreter, *_list_interpreter_options(box), *program.arguments(AGENT_FD, FRAMES)),
            readonly={box.folder: AGENT_FOLDER, frames: FRAMES} | shown | _list_library_mounts(box.backend),
            # A fixed hash seed: the order of an agent's sets must not differ between runs.
            env={"PYTHONPATH": f"{KIT}:{SITE}" if box.site else KIT, "PYTHONHASHSEED": "0"},
            limits=box.limits,
            backend=box.backend,
            rootfs=box.rootfs,
            hidden=box.hidden,
            copies=box.copies,
            live=frozenset({FRAMES}),
            owns_signals=box.owns_signals,
        )
        self._backend, self._log, self._repeated = box.backend, program.log, box.owns_signals
        self._box = sandbox.open_box(spec)
        self._report: sandbox.BoxReport | None = None

    @property
    def socket(self) -> socket.socket:
        """See AgentProcess."""
        return self._box.socket

    @property
    def log_fd(self) -> int:
        """See AgentProcess."""
        return self._box.log_fd

    def wait_readable(self, timeout_s: float) -> bool:
        """See AgentProcess."""
        return self._box.ready(max(timeout_s, 0.0))

    def describe_exit(self) -> str:
        """See AgentProcess."""
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
        """See AgentProcess. Raises BoxError if it was the box that failed."""
        if self._report is None:
            if self._log is not None:
                self._box.pump()
            self._report = self._box.close()
            if self._log is not None:
                write_bytes(self._log, self._box.log())

    def usage_record(self) -> Mapping[str, Any]:
        """See AgentProcess."""
        report = self._box.close()  # closed already; it has a report even if it failed as it was closed
        return {"backend": self._backend, "repeated": self._repeated, **asdict(report)}


def _list_interpreter_options(box: AgentBox) -> tuple[str, ...]:
    """Exclude packages outside of the environment: those of a host would change results."""
    return ("-s", "-S") if box.site else ("-s",)


def _locate_interpreter(box: AgentBox) -> tuple[str, dict[Path, str]]:
    """Return the interpreter's path in the box, and the mounts that it needs."""
    shown = {box.site: SITE} if box.site else {}
    path = Path(box.python)
    if box.rootfs or path.resolve().is_relative_to("/usr"):
        return (box.python if box.rootfs else str(path.resolve())), shown
    path = path.resolve()
    return f"{PYTHON}/bin/{path.name}", shown | {path.parents[1]: PYTHON}


def _list_library_mounts(backend: str) -> dict[Path, str]:
    """Return the mounts of our code without the scenarios. Without a box nothing can be hidden."""
    if backend == "none":
        return {PACKAGE.parent: KIT}
    return {entry: f"{KIT}/{PACKAGE.name}/{entry.name}" for entry in PACKAGE.iterdir() if entry.name not in HIDDEN}
