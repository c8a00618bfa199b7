"""A small pool of worker processes that survives whatever happens to one of them.

libsumo holds one simulation a process and may crash it, so every worker is a fresh interpreter ("spawn") in a
process group of its own: Ctrl-C reaches only the parent, and a worker ends with the agents that it started.
"""

import ctypes
import errno
import os
import signal
import sys
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum, auto
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from mdrive_sumo.errors import InputError, WorldError

J = TypeVar("J")
R = TypeVar("R")

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_CANNOT_WRITE = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO))


class FailureKind(StrEnum):
    """Why a job has no result."""

    DIED = auto()
    """The worker was killed, crashed or left."""
    HUNG = auto()
    """The job was ended because it took longer than the limit."""
    RAISED = auto()
    """The function raised an exception."""
    INPUT = auto()
    """The user has to mend something: an InputError, a full disk."""


@dataclass(frozen=True, slots=True)
class WorkerFailure:
    """A job that has no result; `reason` is one sentence."""

    kind: FailureKind
    reason: str


@dataclass
class _Worker(Generic[J]):
    process: BaseProcess
    pipe: Connection
    job: J | None = None
    started: float = 0.0


class Pool(Generic[J, R]):
    """Runs `function` (top-level, picklable) on jobs in `workers` processes; use it as a context manager.

    A job that takes longer than `limit_s` [s, wall clock] is ended. Workers are reused, dead ones replaced.
    """

    def __init__(self, function: Callable[[J], R], workers: int, limit_s: float) -> None:
        self._function, self._size, self._limit_s = function, workers, limit_s
        self._idle: list[_Worker[J]] = []
        self._busy: list[_Worker[J]] = []

    def __enter__(self) -> "Pool[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        with _without_interrupts():  # a second Ctrl-C must not leave workers behind
            for worker in (*self._idle, *self._busy):
                _end(worker)
            self._idle, self._busy = [], []

    def run(self, jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
        """Every job with its result or failure, in the order in which they finish."""
        queue = deque(jobs)
        while queue or self._busy:
            while queue and len(self._busy) < self._size:
                self._hand_out(queue.popleft())
            yield from self._finished()

    def _hand_out(self, job: J) -> None:
        worker = self._idle.pop() if self._idle else self._start()
        worker.job, worker.started = job, time.monotonic()
        with suppress(BrokenPipeError, ConnectionResetError):  # died idle: seen as a dead worker by `_finished`
            worker.pipe.send(job)
        self._busy.append(worker)

    def _start(self) -> _Worker[J]:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a core for each worker: numpy's own threads only fight
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        # A daemon: should a second Ctrl-C come before `__exit__` holds it back, the interpreter still ends the worker.
        process = context.Process(target=_serve, args=(theirs, self._function), name="mdrive-sumo worker", daemon=True)
        with _without_interrupts():  # the child inherits it, until it has left our process group
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def _finished(self) -> Iterator[tuple[J, R | WorkerFailure]]:
        wait([worker.pipe for worker in self._busy], timeout=self._time_left_s())
        for worker in tuple(self._busy):
            outcome = self._outcome(worker)
            if outcome is None:
                continue
            self._busy.remove(worker)
            if not worker.pipe.closed:
                self._idle.append(worker)
            job = worker.job
            assert job is not None
            yield job, outcome

    def _time_left_s(self) -> float:
        oldest = min(worker.started for worker in self._busy)
        return max(0.0, oldest + self._limit_s - time.monotonic())

    def _outcome(self, worker: _Worker[J]) -> "R | WorkerFailure | None":
        try:
            if worker.pipe.poll():
                return worker.pipe.recv()
        except (EOFError, ConnectionResetError):
            worker.process.join(timeout=2.0)  # so that its own exit code is seen, not that of `_end`
            _end(worker)
            return WorkerFailure(FailureKind.DIED, _how_it_ended(worker.process.exitcode))
        if time.monotonic() - worker.started < self._limit_s:
            return None
        _end(worker)
        return WorkerFailure(FailureKind.HUNG, f"hung: no result within {self._limit_s:g} s")


def available_cores() -> int:
    """Cores that this process may use: what `--workers auto` means."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _without_interrupts() -> Generator[None]:
    """Holds SIGINT back until the end of the block."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(worker: _Worker[Any]) -> None:
    """Ends a worker, dead or alive, and the agents that it started."""
    worker.pipe.close()
    assert worker.process.pid is not None
    with suppress(ProcessLookupError, PermissionError):  # it had not made its own group yet, or all are gone
        os.killpg(worker.process.pid, signal.SIGKILL)
    worker.process.kill()
    worker.process.join()


def _how_it_ended(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"the worker process ended with exit code {exit_code}"
    return f"the worker process was ended by {signal.Signals(-exit_code).name}"


def _serve(pipe: Connection, function: Callable[[Any], Any]) -> None:
    """A worker's life: answers jobs until the parent closes the pipe or dies."""
    _leave_the_terminal_to_the_parent()
    _die_with_parent()
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(_answer(function, job))


def _leave_the_terminal_to_the_parent() -> None:
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _die_with_parent() -> None:
    """Asks Linux for SIGKILL when the parent dies; elsewhere the closed pipe ends a worker after its job."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    parent = parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it died before the line above
        os._exit(1)


def _answer(function: Callable[[Any], Any], job: Any) -> Any:
    try:
        return function(job)
    except InputError as error:
        return WorkerFailure(FailureKind.INPUT, str(error))
    except WorldError as error:
        return WorkerFailure(FailureKind.RAISED, str(error))
    except OSError as error:
        if error.errno in _CANNOT_WRITE:
            return WorkerFailure(FailureKind.INPUT, cannot_write(error, error.filename))
        return WorkerFailure(FailureKind.RAISED, _one_line(error))
    except Exception as error:  # noqa: BLE001 - the border where our own failure becomes a void, with its reason
        return WorkerFailure(FailureKind.RAISED, _one_line(error))


def cannot_write(error: OSError, path: str | Path | None) -> str:
    """One sentence for a full disk, a missing permission and the like."""
    return f"{path or 'the run folder'}: cannot be written: {error.strerror}"


def _one_line(error: Exception) -> str:
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(str(error).split())[:300]
    return f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}: {text}"
