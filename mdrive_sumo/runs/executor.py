"""Executor: where jobs run, on this machine (`pool`) or on others (`dask_executor`). Results are the same, bit for bit.

A job may run more than once (workers die, engines repeat), but gives one outcome. The executor knows jobs by keys of
its user's making.
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
        """How many more jobs would begin at once. Raises InputError if there is nobody left to run any."""
        ...

    def submit(self, key: Key, job: J_contra) -> None:
        """Begins a job."""
        ...

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[Key, R | WorkerFailure]]:
        """Outcomes that are there, after waiting for one, for something to read in `also`, or for the time to be over.

        None waits for ever. Each outcome is given once.
        """
        ...

    def cancel(self, key: Key) -> None:
        """Ends a job and whatever it started; it will have no outcome. Nothing happens if it had one."""
        ...


def run_jobs(executor: Executor[J, R], jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
    """Every job with its result or failure, in the order in which they finish."""
    queue = deque(enumerate(jobs))
    running: dict[Key, J] = {}
    while queue or running:
        while queue and executor.free_slots > 0:
            number, job = queue.popleft()
            running[str(number)] = job
            executor.submit(str(number), job)
        for key, outcome in executor.collect_outcomes():
            yield running.pop(key), outcome
