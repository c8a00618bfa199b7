"""Executor: the interface to worker processes on this machine (`process_pool`) or on others (`dask_executor`).

Results are the same bit for bit. A job may run more than once, because workers die, but has one outcome. The caller
names every job by a key.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import Connection
from socket import socket
from typing import Protocol, TypeVar

from mdrive_sumo.runs.worker_process import WorkerFailure

Key = str
Waitable = Connection | socket | int
"""What `multiprocessing.connection.wait` takes."""
J = TypeVar("J")
J_contra = TypeVar("J_contra", contravariant=True)
R = TypeVar("R")


class Executor(Protocol[J_contra, R]):
    """Runs one function on jobs."""

    @property
    def free_slots(self) -> int:
        """Number of jobs that would start at once. Raises InputError if no worker is left."""
        ...

    def submit(self, key: Key, job: J_contra) -> None:
        """Start a job."""
        ...

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[Key, R | WorkerFailure]]:
        """Wait for an outcome, for something to read in `also` or for the time-out, and return all available outcomes.

        None waits without limit. Each outcome is returned once.
        """
        ...

    def cancel(self, key: Key) -> None:
        """End a job and every process that it started; it has no outcome then. A finished job is left alone."""
        ...


REPORT_INTERVAL_S = 10.0
"""How often the running jobs are reported while none finishes [s]."""
ReportRunning = Callable[[Sequence[tuple[J, float]]], None]
"""Receives the running jobs and for how long each has been running [s], the oldest first."""


def run_jobs(
    executor: Executor[J, R], jobs: Iterable[J], report_running: ReportRunning[J] | None = None
) -> Iterator[tuple[J, R | WorkerFailure]]:
    """Run the jobs and yield each with its result or failure, in the order in which they finish.

    report_running: is called every few seconds as long as no job finishes.
    """
    queue = deque(enumerate(jobs))
    running: dict[Key, tuple[J, float]] = {}
    while queue or running:
        while queue and executor.free_slots > 0:
            number, job = queue.popleft()
            running[str(number)] = job, time.monotonic()
            executor.submit(str(number), job)
        outcomes = executor.collect_outcomes(None if report_running is None else REPORT_INTERVAL_S)
        if not outcomes and report_running is not None:
            now = time.monotonic()
            report_running([(job, now - started_s) for job, started_s in running.values()])
        for key, outcome in outcomes:
            yield running.pop(key)[0], outcome
