"""InProcessExecutor: runs jobs in this process, one after the other, where worker processes cannot be had (Windows)."""

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from mdrive_sumo.runs.executor import Key, Waitable
from mdrive_sumo.runs.worker_process import WorkerFailure, run_job_guarded

J = TypeVar("J")
R = TypeVar("R")


class InProcessExecutor(Generic[J, R]):
    """An Executor without processes: a job that hangs is not ended, and a crash of SUMO ends the run.

    The journal keeps what is finished, so that the same command continues.
    """

    free_slots = 1

    def __init__(self, function: Callable[[J], R]) -> None:
        self._function = function
        self._outcomes: list[tuple[Key, R | WorkerFailure]] = []

    def __enter__(self) -> "InProcessExecutor[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        """There is nothing to end."""

    def submit(self, key: Key, job: J) -> None:
        """See Executor: the job is finished when this returns."""
        self._outcomes.append((key, run_job_guarded(self._function, job)))

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[Key, R | WorkerFailure]]:
        """See Executor."""
        del timeout_s, also
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def cancel(self, key: Key) -> None:
        """See Executor: a job is finished as soon as it is submitted."""
        del key
