"""Choose the executor of a run."""

import importlib.util
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.posix import REMEDY, is_posix
from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.in_process_executor import InProcessExecutor
from mdrive_sumo.runs.process_pool import ProcessPool

J = TypeVar("J")
R = TypeVar("R")
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
