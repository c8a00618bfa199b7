"""A running box: its socket, its log, its end."""

import json
import os
import select
import shutil
import signal
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.cgroups import Cgroup
from mdrive_sumo.agent_process.sandbox.launch import BoxError
from mdrive_sumo.agent_process.sandbox.pipe_ends import LogRing
from mdrive_sumo.agent_process.sandbox.supervisor_process import has_been_killed
from mdrive_sumo.agent_process.sandbox.user_slots import UserSlot

DYING_S = 20.0
"""A killed process may need this long: version 1 groups under memory pressure with a small share of a core."""

GOING_S = {"bubblewrap": 2.0, "gvisor": 5.0, "none": 2.0}
"""For a program that has hung up, so that its own exit code is told and not that it was killed on its way out."""

PROGRAMS = {"bubblewrap": "bubblewrap", "gvisor": "gVisor"}

MOST_WORDS = 300
"""Characters."""

SIGNAL_BASE = 128
"""Shells, bubblewrap and runsc tell a signal as exit code 128 + its number."""

RUNSC_ENDED = 255 - SIGNAL_BASE
"""What runsc ends with if its kernel was ended, and not the program in it, seen as a signal."""

OUTSIDE_SIGNALS = frozenset({1, 2, 9, 15, RUNSC_ENDED})
"""SIGHUP, SIGINT, SIGKILL and SIGTERM, which an operator, earlyoom or a service manager sends, and which a program may
also send to itself. Others are the program's own: faults (SEGV, BUS, FPE, ILL), ABRT, SYS, and those of limits (XCPU,
XFSZ). Numbers, because Windows lacks the names."""


class BoxKilledError(BoxError):
    """A signal that may have come from outside ended the program, or the supervisor that answers its `fstat`.

    Repeat it once, with `BoxSpec.owns_signals`.
    """


@dataclass(frozen=True, slots=True)
class BoxReport:
    """How a box ended and what it used. Numbers that this machine cannot count are None."""

    exit_code: int | None
    """Of the program itself; None if a signal, or `close`, ended it."""
    signal: int | None
    """That ended the program, or the whole box."""
    oom_killed: bool
    peak_memory_bytes: int | None
    cpu_s: float | None
    wall_s: float
    log_bytes: int
    """Everything printed, also what was not kept."""
    clean: bool
    """Whether every process is gone. If not, the slot stays taken until this process ends."""


@dataclass(frozen=True, slots=True)
class BoxParts:
    """What a box holds of the kernel; `Box` ends with all of it given back."""

    pid: int
    pidfd: int
    status: int
    """Reading end of bubblewrap's own report."""
    supervisor: socket.socket | None
    """From the supervisor of `fstat`; None: the box has none."""
    slot: UserSlot
    group: Cgroup | None
    began: float
    folder: Path | None
    """Of the box alone, removed with it; None where it needs none."""
    cpu_limit_s: int
    """CPU time of a process, at which the kernel ends it."""
    owns_signals: bool
    """See `BoxSpec.owns_signals`."""


class Box:
    """One isolated program. `open_box` makes it; its caller closes it."""

    def __init__(self, parts: BoxParts, own_end: socket.socket, log: LogRing, backend: str) -> None:
        self.socket = own_end
        """Our end of the socketpair, blocking; a stream."""
        self._parts = parts
        self._log = log
        self._backend = backend
        self._wait_status: int | None = None
        self._report: BoxReport | None = None

    @property
    def slot(self) -> int:
        """Its place on this host."""
        return self._parts.slot.number

    @property
    def pid(self) -> int:
        """Of the process that holds the box; when it ends, everything inside does."""
        return self._parts.pid

    @property
    def log_fd(self) -> int:
        """To wait on beside the socket; -1 once every process inside has closed it."""
        return self._log.fd

    def pump(self) -> None:
        """Takes over what was printed. Call it while waiting: a program that prints stops when 64 KB are unread."""
        self._log.pump()

    def log(self) -> bytes:
        """The last of what was printed, at most `limits.log_bytes`."""
        self._log.pump()
        return self._log.text()

    def ready(self, timeout_s: float) -> bool:
        """Waits until the socket has something to read, or its other end is gone; keeps the log flowing meanwhile."""
        end = time.monotonic() + timeout_s
        poller = select.poll()
        poller.register(self.socket, select.POLLIN)
        while True:
            if self._log.fd >= 0:
                poller.register(self._log.fd, select.POLLIN)
            events = dict(poller.poll(max(0.0, end - time.monotonic()) * 1000))
            if self._log.fd in events:
                log_fd = self._log.fd
                self._log.pump()
                if self._log.fd < 0:
                    poller.unregister(log_fd)
            if self.socket.fileno() in events:
                return True
            if time.monotonic() >= end:
                return False

    def alive(self) -> bool:
        """Whether the box still runs."""
        return self._report is None and not self._wait_for_exit(0.0)

    def close(self) -> BoxReport:
        """Kills whatever still runs and gives everything back; waits only as long as the times above allow.

        Raises BoxError if bubblewrap failed before the program had begun, or was killed from outside, and if memory ran
        out on the host (or in the evaluator's group) while the box kept to its own limit; BoxKilledError if a signal
        that may have come from outside ended the program or its supervisor.
        """
        if self._report is None:
            self._report = self._close_and_report()
        return self._report

    def __enter__(self) -> "Box":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _has_hung_up(self) -> bool:
        """Whether the program has let go of the socket, as when it has just ended.

        gVisor then shuts down only its own direction, and holds the descriptor until it is gone itself.
        """
        poller = select.poll()
        poller.register(self.socket, select.POLLRDHUP)
        return bool(poller.poll(0))

    def _wait_for_exit(self, wait_s: float) -> bool:
        """Whether the launched process is gone, after waiting for it at most so long; collects it if so."""
        poller = select.poll()
        poller.register(self._parts.pidfd, select.POLLIN)
        if self._wait_status is None and poller.poll(wait_s * 1000):
            self._wait_status = os.waitpid(self._parts.pid, 0)[1]
        return self._wait_status is not None

    def _close_and_report(self) -> BoxReport:
        parts, by_itself = self._parts, self._wait_for_exit(GOING_S[self._backend] if self._has_hung_up() else 0.0)
        # Asked before the group is killed, to which the supervisor belongs.
        unsupervised = parts.supervisor is not None and has_been_killed(parts.supervisor)
        if not by_itself:
            with suppress(ProcessLookupError):
                os.killpg(parts.pid, signal.SIGKILL)
        if parts.group is not None:
            parts.group.kill()
        clean = self._wait_for_exit(DYING_S)
        peak, cpu, oom = _read_usage(parts.group)
        starved = oom and parts.group is not None and not parts.group.reached_own_limit()
        if parts.group is not None:
            clean = parts.group.remove(DYING_S) and clean
        self._log.pump()
        ours, problem = self._is_our_failure(by_itself, oom), self._log.text()
        self._release(clean)
        exit_code, ended_by = _decode_status(self._wait_status, self._backend)
        report = BoxReport(
            exit_code, ended_by, oom, peak, cpu, time.monotonic() - parts.began, self._log.seen_bytes, clean
        )
        killed = "" if oom or parts.owns_signals else self._find_killed(report, by_itself, unsupervised)
        if ours or starved or killed:
            self._report = report
        if starved:
            raise BoxError("sandbox: the kernel ended a process of the box for want of memory outside of it")
        if ours and not (killed and unsupervised):  # bubblewrap fails, too, if it loses the supervisor
            why = f"ended by signal {ended_by} from outside" if ended_by is not None else _read_last_words(problem)
            raise BoxError(f"sandbox: {PROGRAMS[self._backend]} failed: {why}")
        if killed:
            raise BoxKilledError(f"sandbox: {killed}, which may have come from outside")
        return report

    def _is_our_failure(self, by_itself: bool, oom: bool) -> bool:
        """Whether it was not the program that ended the box: bubblewrap gave up, or a process outside killed it.

        bubblewrap tells an exit code only if the program had begun. It cannot once memory has run out and the kernel
        has killed the box's first process, which a program may bring about. No program in a box can send a signal to
        the launched process, whatever the backend: it is outside of the box's processes.
        """
        with os.fdopen(self._parts.status, "rb", buffering=0) as pipe:
            text = pipe.read(4096) or b""
        if not by_itself or oom or self._backend == "none":
            return False
        if self._wait_status is not None and os.WIFSIGNALED(self._wait_status):
            return True
        return self._backend == "bubblewrap" and not any("exit-code" in json.loads(line) for line in text.splitlines())

    def _find_killed(self, report: BoxReport, by_itself: bool, unsupervised: bool) -> str:
        """Return what a process outside may have ended, and how; "" if none: nothing tells the sender of a signal.

        A program that has used up its CPU time was ended for that. The program may have gone on without its supervisor,
        but it was told errors.
        """
        if unsupervised:
            return "the supervisor of the box was ended by a signal"
        spent = report.cpu_s is not None and report.cpu_s >= self._parts.cpu_limit_s
        if self._backend == "none" or not by_itself or spent or report.signal not in OUTSIDE_SIGNALS:
            return ""
        return f"the program ended by signal {report.signal}"

    def _release(self, clean: bool) -> None:
        self._log.close()
        self.socket.close()
        os.close(self._parts.pidfd)
        if self._parts.supervisor is not None:
            self._parts.supervisor.close()
        if self._parts.folder is not None:
            shutil.rmtree(self._parts.folder, ignore_errors=True)
        self._parts.slot.release(clean)


def _read_last_words(log: bytes) -> str:
    """What bubblewrap said, and nothing that a program may have printed."""
    said = [line for line in log.decode(errors="replace").splitlines() if line.startswith("bwrap: ")]
    return said[-1][:MOST_WORDS] if said else "it did not say why"


def _read_usage(group: Cgroup | None) -> tuple[int | None, float | None, bool]:
    """Peak memory [bytes], CPU time [s], and whether memory ran out."""
    if group is None:
        return None, None, False
    return group.peak_memory_bytes(), group.cpu_s(), group.oom_killed()


def _decode_status(status: int | None, backend: str) -> tuple[int | None, int | None]:
    """Exit code and signal of the program in the box."""
    if status is None:
        return None, None
    if os.WIFSIGNALED(status):
        return None, os.WTERMSIG(status)
    code = os.WEXITSTATUS(status)
    return (None, code - SIGNAL_BASE) if backend != "none" and code > SIGNAL_BASE else (code, None)
