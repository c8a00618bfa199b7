"""WorkerProcess: a child process that runs one job at a time and can be ended at any moment.

libsumo holds one simulation a process and may crash it, so jobs run in processes of their own, which a `ForkServer`
starts. Jobs run in the main thread, which boxes require.
"""

import errno
import os
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum, auto
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from typing import Any, Generic, TypeVar

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.runs.fork_server import ForkServer

J = TypeVar("J")
R = TypeVar("R")

_CANNOT_WRITE = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO))


class FailureKind(StrEnum):
    """Why a job has no result."""

    DIED = auto()
    """The worker was killed, crashed or exited."""
    HUNG = auto()
    """The job was ended because it took longer than the limit."""
    RAISED = auto()
    """The function raised an exception."""
    INPUT = auto()
    """The user has to correct something: an InputError, a full disk, a module that workers cannot import."""


@dataclass(frozen=True, slots=True)
class WorkerFailure:
    """Why a job has no result; `reason` is one sentence."""

    kind: FailureKind
    reason: str


ANSWER_LIMIT_S = 10.0
"""How long the fork server may take to say what happened to a worker [s], its own start of a second included."""


class WorkerProcess(Generic[J, R]):
    """A worker process of a server made by `make_fork_server`; use it in the thread that made the server."""

    def __init__(self, server: ForkServer) -> None:
        self._server = server
        self.pipe, theirs = Pipe()
        """Readable when there is an outcome."""
        self._state, state = Pipe(duplex=False)
        self._pid: int | None = None
        self._exit_code: int | None = None
        self._lock = Lock()
        with theirs, state:
            server.start_worker(theirs, state)

    @property
    def is_usable(self) -> bool:
        """Whether it can run another job; False after `end`."""
        return not self.pipe.closed

    def start_job(self, job: J) -> None:
        """Start a job; the previous one must be finished."""
        with suppress(BrokenPipeError, ConnectionResetError):  # died idle: `poll_outcome` reports it
            self.pipe.send(job)

    def poll_outcome(self) -> R | WorkerFailure | None:
        """Return the outcome of the job, None while it runs. After DIED the worker is ended."""
        try:
            return self.pipe.recv() if self.pipe.poll() else None
        except (EOFError, OSError):  # OSError: it died while it was sending
            exit_code = self._find_exit_code()  # its own, not that of `end`
            failure = self._server.find_start_failure() if self._find_pid() is None else ""
            self.end()
            if failure:
                return WorkerFailure(FailureKind.INPUT, f"worker processes cannot start: {failure}")
            return WorkerFailure(FailureKind.DIED, _describe_exit(exit_code))

    def kill(self) -> None:
        """End the job with its worker, also from another thread; `poll_outcome` then returns DIED."""
        if self.is_usable:
            self._kill()

    def _kill(self) -> None:
        if (pid := self._find_pid()) is not None:
            for send in (os.killpg, os.kill):  # it may not have made its own group yet
                with suppress(ProcessLookupError, PermissionError):
                    send(pid, signal.SIGKILL)

    def end(self) -> None:
        """End the worker, dead or alive, and the agents that it started."""
        self.pipe.close()
        self._kill()
        self._find_exit_code()
        self._state.close()

    def _find_pid(self) -> int | None:
        """Return its process id; None if the server died before it had one. Waits while the server starts."""
        with self._lock:  # `kill` and `poll_outcome` of different threads
            if self._pid is None:
                self._pid = self._receive_state()
            return self._pid

    def _find_exit_code(self) -> int | None:
        """Return the exit code of a dead or dying worker; that of the server if both died together."""
        if self._exit_code is None and self._find_pid() is not None:
            self._exit_code = self._receive_state()
        return self._server.exit_code if self._exit_code is None else self._exit_code

    def _receive_state(self) -> int | None:
        """Return the next number from the server, None if there will be none."""
        try:
            return self._state.recv() if self._state.poll(ANSWER_LIMIT_S) else None
        except (EOFError, OSError):
            return None


def make_fork_server(function: Callable[[Any], Any]) -> ForkServer:
    """Return the server of workers for `function`, which is top-level and picklable."""
    return ForkServer(partial(_serve_jobs, function))


def describe_write_error(error: OSError, path: str | Path | None) -> str:
    """Return one sentence about a full disk, a missing permission or a similar error."""
    return f"{path or 'the run folder'}: cannot be written: {error.strerror}"


def _describe_exit(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"the worker process ended with exit code {exit_code}"
    return f"the worker process was ended by {signal.Signals(-exit_code).name}"


def _serve_jobs(function: Callable[[Any], Any], pipe: Connection) -> None:
    """Run jobs in the worker until the owner closes the pipe or dies."""
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(run_job_guarded(function, job))


def run_job_guarded(function: Callable[[Any], Any], job: Any) -> Any:
    """Return the result of a job, or a WorkerFailure for whatever it raises."""
    try:
        return function(job)
    except InputError as error:
        return WorkerFailure(FailureKind.INPUT, str(error))
    except WorldError as error:
        return WorkerFailure(FailureKind.RAISED, str(error))
    except OSError as error:
        if error.errno in _CANNOT_WRITE:
            return WorkerFailure(FailureKind.INPUT, describe_write_error(error, error.filename))
        return WorkerFailure(FailureKind.RAISED, _format_exception(error))
    except Exception as error:  # noqa: BLE001 - the border where our own failure becomes a void, with its reason
        return WorkerFailure(FailureKind.RAISED, _format_exception(error))


def _format_exception(error: Exception) -> str:
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(str(error).split())[:300]
    return f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {text}"
