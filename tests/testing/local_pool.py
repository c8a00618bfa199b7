"""Jobs of a ProcessPool run in this process: for tests whose subject is not the process, which starts in seconds."""

from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

from mdrive_sumo.runs import worker_process
from mdrive_sumo.runs.process_pool import WorkerFailure

J = TypeVar("J")
R = TypeVar("R")


class LocalPool(Generic[J, R]):
    """A ProcessPool that only runs a batch of jobs: one after the other, with failures described as by a worker."""

    def __init__(self, function: Callable[[J], R], workers: int, limit_s: float) -> None:
        self._function = function

    def __enter__(self) -> "LocalPool[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        """There is nothing to end."""

    def run(self, jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
        for job in jobs:
            yield job, worker_process._run_job(self._function, job)
