"""Chooses the executor of a run."""

import importlib.util
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.process_pool import ProcessPool

J = TypeVar("J")
R = TypeVar("R")
ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):\d{1,5}")


def make_executor(
    function: Callable[[J], R], workers: int, limit_s: float, scheduler: str = ""
) -> AbstractContextManager[Executor[J, R]]:
    """`workers` processes here, or those of the Dask cluster whose scheduler is named.

    `function` is top-level and picklable, a job may take `limit_s` [s, wall clock]. Raises InputError where there is no
    such scheduler, or no Dask.
    """
    if not scheduler:
        return ProcessPool[J, R](function, workers, limit_s)
    check_scheduler_address(scheduler)
    from mdrive_sumo.runs.dask_executor import DaskExecutor

    return DaskExecutor[J, R](function, scheduler, limit_s)


def check_scheduler_address(scheduler: str) -> None:
    """Raises InputError for what is no address (Dask needs half a minute for that), and where Dask is not installed."""
    if ADDRESS.fullmatch(scheduler) is None:
        raise InputError(f"--scheduler: expected tcp://HOST:PORT of a Dask scheduler, found {scheduler!r:.80}")
    if importlib.util.find_spec("distributed") is None:
        raise InputError("--executor dask: expected the package distributed; install mdrive-sumo[dask]")
