"""A worker: a process that works for a server until it is told to stop, or its server is gone.

The settings come as one line of JSON by standard input, where no list of processes shows the database's password. The
end of that input is the server's death: the worker then gives its jobs back, as it does on SIGTERM.
"""

import logging
import os
import select
import socket
import sys
import threading
from collections.abc import Callable

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.prepared_run import SIMULATION_LIMIT_S
from server.clock import now_us
from server.evaluation.dispatcher import Dispatcher
from server.evaluation.job_task import JobResult, JobTask
from server.evaluation.machine_check import check_machine
from server.evaluation.stop_request import StopRequest
from server.evaluation.submission_job import run_submission_job
from server.phase_suites import LoadedPhaseSuites
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, phases
from server.store.errors import new_id

LOG = logging.getLogger("mdrive.worker")
NICE = 5
"""Whoever asks the server is answered first."""


def main(function: Callable[[JobTask], JobResult] = run_submission_job, clock: Callable[[], int] = now_us) -> int:
    """`python -m server.evaluation.worker`: exit code 0 if it was told to stop."""
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s")
    stop = StopRequest()
    stop.on_signals()
    os.nice(NICE)
    try:
        settings = ServerSettings.model_validate_json(_read_line(0))
        threading.Thread(target=_stop_on_eof, args=(0, stop), daemon=True).start()
        run_worker(settings, stop, function, clock)
    except (InputError, StoreUnavailable, ValidationError) as error:
        LOG.error("%s", error)
        return 2
    return 0


def run_worker(
    settings: ServerSettings, stop: StopRequest, function: Callable[[JobTask], JobResult], clock: Callable[[], int]
) -> None:
    """Drives what is in the queue with one process, or with the workers of a Dask cluster.

    Raises InputError where this machine is not fit for it, StoreUnavailable.
    """
    check_machine(settings)
    work = settings.work
    store = Store(settings.database_url)
    try:
        suites = LoadedPhaseSuites(settings)
        limit_s = _compute_limit_s(store, settings, suites)
        with make_executor(function, 1, limit_s, work.scheduler) as executor:
            Dispatcher(store, settings, suites, executor, make_owner(), clock).run(stop)
    finally:
        store.close()


def make_owner() -> str:
    """A name that no process had or will have."""
    return f"{socket.gethostname()[:24]}.{os.getpid()}.{new_id()[:12]}"


def _compute_limit_s(store: Store, settings: ServerSettings, suites: LoadedPhaseSuites) -> float:
    """Wall clock after which a job hangs, whatever its agents do: more than they may take together.

    It reads all suites, which must not happen in the transaction of the first claim.
    """
    with store.read() as session:
        every = phases.list_phases(session)
    egos = [len(scenario.egos) for phase in every for scenario in suites.suite(phase).scenarios]
    limits = settings.sandbox.line_limits()
    return SIMULATION_LIMIT_S + max(egos, default=1) * (2 * limits.start_s + limits.episode_s)


def _read_line(fd: int) -> bytes:
    """Up to a line's end, and no byte more: `_stop_at_end` waits for the rest."""
    line = b""
    while not line.endswith(b"\n"):
        byte = os.read(fd, 1)
        if not byte:
            raise InputError("worker: expected settings as a line of JSON on standard input, found its end")
        line += byte
    return line


def _stop_on_eof(fd: int, stop: StopRequest) -> None:
    poller = select.poll()
    poller.register(fd, select.POLLIN | select.POLLHUP)
    while True:
        poller.poll()
        if not os.read(fd, 4096):
            stop.wish()
            return


if __name__ == "__main__":
    sys.exit(main())
