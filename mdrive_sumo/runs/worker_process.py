"""WorkerProcess: a child process that runs one job at a time and can be ended at any moment.

libsumo holds one simulation a process and may crash it, so every worker is a fresh interpreter ("spawn") in a
process group of its own: Ctrl-C reaches only the parent, and a worker ends with the agents that it started. Jobs run in
its main thread, which boxes require. A worker ends with the *thread* that created it: use it in one thread only.
"""

import ctypes
import errno
import os
import signal
import sys
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum, auto
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any, Generic, TypeVar

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.posix import check_posix

J = TypeVar("J")
R = TypeVar("R")

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
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
    """The user has to correct something: an InputError, a full disk."""


@dataclass(frozen=True, slots=True)
class WorkerFailure:
    """Why a job has no result; `reason` is one sentence."""

    kind: FailureKind
    reason: str


class WorkerProcess(Generic[J, R]):
    """A worker process for `function`, which is top-level and picklable."""

    def __init__(self, function: Callable[[J], R]) -> None:
        check_posix("a worker process")
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a core for each worker: numpy's own threads only fight
        if current_process().daemon:  # as workers of Dask are: Python would let them have no processes of their own
            current_process().daemon = False
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        """Readable when there is an outcome."""
        # A daemon: the interpreter still ends the worker if a second Ctrl-C comes before its owner blocks it.
        self._process = context.Process(
            target=_serve_jobs, args=(theirs, function), name="mdrive-sumo worker", daemon=True
        )
        with block_interrupts(), _hide_main_module():  # the child inherits the mask until it leaves our process group
            self._process.start()
        theirs.close()

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
            self._process.join(timeout=2.0)  # so that its own exit code is seen, not that of `end`
            self.end()
            return WorkerFailure(FailureKind.DIED, _describe_exit(self._process.exitcode))

    def kill(self) -> None:
        """End the job with its worker, also from another thread; `poll_outcome` then returns DIED."""
        if self.is_usable:
            self._kill()

    def _kill(self) -> None:
        assert self._process.pid is not None
        with suppress(ProcessLookupError, PermissionError):  # it had not made its own group yet, or all are gone
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()

    def end(self) -> None:
        """End the worker, dead or alive, and the agents that it started."""
        self.pipe.close()
        self._kill()
        self._process.join()


@contextmanager
def block_interrupts() -> Generator[None]:
    """Block SIGINT until the end of the block."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_MAIN_MODULE_LOCK = Lock()


@contextmanager
def _hide_main_module() -> Generator[None]:
    """Keep a spawned child from importing the caller's `__main__`.

    A worker needs nothing of it, and the import would run a script that has no main guard a second time.
    """
    with _MAIN_MODULE_LOCK:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


def describe_write_error(error: OSError, path: str | Path | None) -> str:
    """Return one sentence about a full disk, a missing permission or a similar error."""
    return f"{path or 'the run folder'}: cannot be written: {error.strerror}"


def _describe_exit(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"the worker process ended with exit code {exit_code}"
    return f"the worker process was ended by {signal.Signals(-exit_code).name}"


def _serve_jobs(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """Run jobs in the worker until the parent closes the pipe or dies."""
    _ignore_terminal_signals()
    _die_with_parent()
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(run_job_guarded(function, job))


def _ignore_terminal_signals() -> None:
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _die_with_parent() -> None:
    """Ask Linux for SIGKILL when the parent dies; elsewhere the closed pipe ends a worker after its job."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    parent = parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it died before the line above
        os._exit(1)


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
