"""DaskExecutor: an Executor on a Dask cluster, whose workers run each job in the main thread of a child process.

A worker of Dask runs tasks in threads, but a simulation and boxes need a process. The files that a job reads must be at
the same path on every machine, and the code must be the same: other workers are refused. Dask unpickles what it
receives, so its ports are for a trusted network only.
"""

import os
import pickle
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from multiprocessing.connection import wait
from typing import Any, Generic, NamedTuple, TypeVar, cast

from distributed import Client, Future

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.executor import Key, Waitable
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.runs.fork_server import ForkServer
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure, WorkerProcess, make_fork_server

J = TypeVar("J")
R = TypeVar("R")

CONNECT_S = 15.0
"""How long a scheduler may take to answer [s]; chosen: a user who mistyped its address waits so long."""
CHECK_INTERVAL_S = 1.0
"""How often the scheduler is asked for its number of workers [s]."""
MAX_WORKERLESS_S = 60.0
"""How long a run waits for workers to come back [s]."""


class ExecutorLostError(InputError):
    """The executor is lost, with every running job."""


class DaskExecutor(Generic[J, R]):
    """See Executor. A context manager for one thread."""

    def __init__(self, function: Callable[[J], R], scheduler: str, limit_s: float) -> None:
        """Connect to a scheduler. Raises InputError if none answers."""
        self._function, self._address, self._limit_s = function, scheduler, limit_s
        try:
            self._client = Client(scheduler, timeout=CONNECT_S, set_as_default=False, name="mdrive-sumo")
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
        self._prefix = f"mdrive-{os.urandom(4).hex()}-"  # Dask takes equal keys for equal results
        self._running: dict[Key, Future[Any]] = {}
        self._outcomes: queue.SimpleQueue[tuple[Key, Any]] = queue.SimpleQueue()
        self._reading, self._writing = os.pipe()
        self._threads, self._checked_at, self._workers_seen_at = 0, -CHECK_INTERVAL_S, time.monotonic()

    def __enter__(self) -> "DaskExecutor[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        for key in tuple(self._running):
            with suppress(ExecutorLostError):
                self.cancel(key)
        with suppress(OSError):
            self._client.close(timeout=5)
        os.close(self._reading)

    @property
    def free_slots(self) -> int:
        """See Executor."""
        self._check_scheduler()
        return max(self._threads - len(self._running), 0)

    def submit(self, key: Key, job: J) -> None:
        """See Executor."""
        name = self._prefix + key
        task = self._client.submit(
            run_in_child_process, name, self._function, job, self._limit_s, _read_code_state(), key=name, pure=False
        )
        self._running[key] = task
        task.add_done_callback(partial(self._take_over_outcome, key))

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[Key, R | WorkerFailure]]:
        """See Executor. Raises ExecutorLostError, also if there have been no workers for a while."""
        end = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left_s = CHECK_INTERVAL_S if end is None else min(CHECK_INTERVAL_S, max(0.0, end - time.monotonic()))
            readable = wait([self._reading, *also], timeout=left_s)
            outcomes = self._collect()
            if outcomes or set(readable) - {self._reading} or (end is not None and time.monotonic() >= end):
                return outcomes
            self._check_scheduler()
            if not self._running and end is None:
                return []

    def cancel(self, key: Key) -> None:
        """See Executor."""
        future = self._running.pop(key, None)
        if future is None or self._client.status != "running":
            return
        with suppress(OSError):
            future.cancel(force=True)
            self._client.run(end_task, self._prefix + key, on_error="ignore")

    def _check_scheduler(self) -> None:
        now = time.monotonic()
        if now - self._checked_at < CHECK_INTERVAL_S:
            return
        self._checked_at = now
        try:
            if self._client.status != "running":
                raise OSError("connection closed")
            self._threads = sum(cast(dict[str, int], self._client.nthreads()).values())
        except OSError as error:
            raise self._make_lost_error(str(error)) from None
        if self._threads:
            self._workers_seen_at = now
        elif now - self._workers_seen_at > MAX_WORKERLESS_S:
            raise self._make_lost_error(f"it has had no workers for {MAX_WORKERLESS_S:g} s")

    def _make_lost_error(self, why: str) -> ExecutorLostError:
        self._running.clear()
        return ExecutorLostError(f"the Dask scheduler at {self._address} is lost: {why}")

    def _take_over_outcome(self, key: Key, future: Future[Any]) -> None:
        """Fetch the outcome at once, in a thread of Dask's: it would be lost with its worker."""
        try:
            outcome = future.result(timeout=CONNECT_S) if future.status == "finished" else _describe_failure(future)
        except Exception as error:  # noqa: BLE001 - whatever Dask raises, the job has no result
            outcome = WorkerFailure(FailureKind.DIED, f"Dask: {type(error).__name__}: {error}")
        self._outcomes.put((key, outcome))
        with suppress(OSError):  # closed in the meantime
            os.write(self._writing, b".")

    def _collect(self) -> list[tuple[Key, R | WorkerFailure]]:
        outcomes: list[tuple[Key, R | WorkerFailure]] = []
        while not self._outcomes.empty():
            os.read(self._reading, 1)
            key, outcome = self._outcomes.get()
            if self._running.pop(key, None) is None:
                continue  # ended
            if outcome is None:
                raise self._make_lost_error("its connection broke")
            outcomes.append((key, outcome))
        return outcomes


def _describe_failure(future: Future[Any]) -> WorkerFailure | None:
    """Return the failure of a job; None if the connection to the scheduler broke."""
    if future.status != "error":
        return None
    return WorkerFailure(FailureKind.DIED, f"Dask: {future.exception()!r:.300}")


@lru_cache(maxsize=1)
def _read_code_state() -> dict[str, str]:
    return read_versions() | {"code": compute_code_checksum()}


_local = threading.local()
_jobs: dict[str, WorkerProcess[Any, Any]] = {}
"""On a Dask worker: the running jobs by task name, for `end_task`."""


def run_in_child_process(
    name: str, function: Callable[[J], R], job: J, limit_s: float, code: dict[str, str]
) -> R | WorkerFailure:
    """Run a job in the child process of this thread of a Dask worker."""
    here = _read_code_state()
    if here != code:
        differing = ", ".join(f"{key} {here.get(key)}" for key in sorted(code) if here.get(key) != code[key])
        return WorkerFailure(FailureKind.INPUT, f"a worker of Dask: expected the same code as here, found {differing}")
    worker = _get_worker_process(function)
    _jobs[name] = worker
    try:
        worker.start_job(job)
        wait([worker.pipe], timeout=limit_s)
        outcome = worker.poll_outcome()
    finally:
        _jobs.pop(name, None)
    if outcome is None:
        worker.end()
        return WorkerFailure(FailureKind.HUNG, f"hung: no result within {limit_s:g} s")
    return outcome


def end_task(name: str) -> None:
    """End a job on a Dask worker if it runs there."""
    worker = _jobs.get(name)
    if worker is not None:
        worker.kill()


class _KeptWorker(NamedTuple):
    function: bytes
    """Pickled."""
    server: ForkServer
    worker: WorkerProcess[Any, Any]


def _get_worker_process(function: Callable[[Any], Any]) -> WorkerProcess[Any, Any]:
    """Return this thread's child process, which is reused and ends with the thread."""
    pickled = pickle.dumps(function)
    kept: _KeptWorker | None = getattr(_local, "kept", None)
    if kept is not None and kept.function == pickled and kept.worker.is_usable:
        return kept.worker
    if kept is not None and kept.worker.is_usable:
        kept.worker.end()
    if kept is not None and kept.function == pickled:
        server = kept.server
    else:
        if kept is not None:
            kept.server.end()
        server = make_fork_server(function)
    _local.kept = _KeptWorker(pickled, server, WorkerProcess[Any, Any](server))
    return _local.kept.worker
