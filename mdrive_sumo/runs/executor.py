"""Executor: the interface to worker processes on this machine (`process_pool`) or on others (`dask_executor`).

Results are the same bit for bit. A job may run more than once, because workers die, but has one outcome. The caller
names every job by a key.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
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


def run_jobs(executor: Executor[J, R], jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
    """Run the jobs and yield each with its result or failure, in the order in which they finish."""
    queue = deque(enumerate(jobs))
    running: dict[Key, J] = {}
    while queue or running:
        while queue and executor.free_slots > 0:
            number, job = queue.popleft()
            running[str(number)] = job
            executor.submit(str(number), job)
        for key, outcome in executor.collect_outcomes():
            yield running.pop(key), outcome
