"""Choose the executor of a run: worker processes here, those of a Dask cluster, or none where there are none."""

import importlib.util
import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Generic, TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.posix import REMEDY, is_posix
from mdrive_sumo.runs.executor import Executor, Key, Waitable
from mdrive_sumo.runs.process_pool import ProcessPool
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


ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):\d{1,5}")


def make_executor(
    function: Callable[[J], R], workers: int, limit_s: float, scheduler: str = ""
) -> AbstractContextManager[Executor[J, R]]:
    """Return an executor with `workers` processes here, or with the workers of a Dask scheduler.

    function: top-level and picklable. limit_s: wall clock of one job [s]. Raises InputError without such a scheduler or
    without Dask.
    """
    if not is_posix():
        if workers > 1 or scheduler:
            raise InputError(f"--workers: expected 1, found {workers}: a worker process {REMEDY}")
        return InProcessExecutor[J, R](function)
    if not scheduler:
        return ProcessPool[J, R](function, workers, limit_s)
    check_scheduler_address(scheduler)
    from mdrive_sumo.runs.dask_executor import DaskExecutor

    return DaskExecutor[J, R](function, scheduler, limit_s)


def check_scheduler_address(scheduler: str) -> None:
    """Raise InputError for an unusable address (Dask itself needs half a minute for it), and without Dask."""
    if ADDRESS.fullmatch(scheduler) is None:
        raise InputError(f"--scheduler: expected tcp://HOST:PORT of a Dask scheduler, found {scheduler!r:.80}")
    if importlib.util.find_spec("distributed") is None:
        raise InputError(
            f"--executor dask: expected the package distributed, found none; {format_installation('dask')}"
        )
