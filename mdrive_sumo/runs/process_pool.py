"""ProcessPool: worker processes on this machine; the death of one costs only its job."""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Generic, TypeVar

from mdrive_sumo.core.posix import is_posix
from mdrive_sumo.runs.executor import Key, Waitable, run_jobs
from mdrive_sumo.runs.fork_server import ForkServer, block_interrupts
from mdrive_sumo.runs.worker_process import (
    FailureKind,
    WorkerFailure,
    WorkerProcess,
    describe_write_error,
    make_fork_server,
)

__all__ = ["FailureKind", "ProcessPool", "WorkerFailure", "count_available_cores", "describe_write_error"]

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class _BusyWorker(Generic[J, R]):
    key: Key
    worker: WorkerProcess[J, R]
    started: float


class ProcessPool(Generic[J, R]):
    """The local Executor: a context manager that runs `function` (top-level, picklable) in `workers` processes.

    A job that takes longer than `limit_s` [s, wall clock] is ended. Workers are reused, dead ones replaced.
    """

    def __init__(self, function: Callable[[J], R], workers: int, limit_s: float) -> None:
        self._function, self._size, self._limit_s = function, workers, limit_s
        self._server: ForkServer | None = None
        self._idle: list[WorkerProcess[J, R]] = []
        self._busy: list[_BusyWorker[J, R]] = []

    def __enter__(self) -> "ProcessPool[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        with block_interrupts():  # a second Ctrl-C must not leave workers behind
            for worker in (*self._idle, *(busy.worker for busy in self._busy)):
                worker.end()
            self._idle, self._busy = [], []
            if self._server is not None:
                self._server.end()
                self._server = None

    def run(self, jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
        """Run the jobs and yield each with its result or failure, in the order in which they finish."""
        return run_jobs(self, jobs)

    @property
    def free_slots(self) -> int:
        """See Executor."""
        return self._size - len(self._busy)

    def submit(self, key: Key, job: J) -> None:
        """See Executor."""
        worker = self._idle.pop() if self._idle else self._start_worker()
        self._busy.append(_BusyWorker(key, worker, time.monotonic()))
        worker.start_job(job)

    def warm_up(self) -> None:
        """Begin the imports of the workers, which take half a second; the first job begins them otherwise."""
        self._server = self._server or make_fork_server(self._function)

    def _start_worker(self) -> WorkerProcess[J, R]:
        self.warm_up()
        assert self._server is not None
        return WorkerProcess(self._server)

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[Key, R | WorkerFailure]]:
        """See Executor."""
        wait([*(busy.worker.pipe for busy in self._busy), *also], timeout=self._compute_wait_s(timeout_s))
        outcomes: list[tuple[Key, R | WorkerFailure]] = []
        for busy in tuple(self._busy):
            outcome = self._poll_outcome(busy)
            if outcome is not None:
                self._release(busy)
                outcomes.append((busy.key, outcome))
        return outcomes

    def cancel(self, key: Key) -> None:
        """See Executor."""
        for busy in tuple(self._busy):
            if busy.key == key:
                busy.worker.end()
                self._release(busy)

    def _release(self, busy: _BusyWorker[J, R]) -> None:
        self._busy.remove(busy)
        if busy.worker.is_usable:
            self._idle.append(busy.worker)

    def _compute_wait_s(self, timeout_s: float | None) -> float | None:
        if not self._busy:
            return timeout_s
        oldest = min(busy.started for busy in self._busy)
        left_s = max(0.0, oldest + self._limit_s - time.monotonic())
        return left_s if timeout_s is None else min(left_s, timeout_s)

    def _poll_outcome(self, busy: _BusyWorker[J, R]) -> "R | WorkerFailure | None":
        outcome = busy.worker.poll_outcome()
        if outcome is None and time.monotonic() - busy.started >= self._limit_s:
            busy.worker.end()
            return WorkerFailure(FailureKind.HUNG, f"hung: no result within {self._limit_s:g} s")
        return outcome


def count_available_cores() -> int:
    """Return what `--workers auto` means: the number of cores that this process may use; 1 without worker processes."""
    if not is_posix():
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
