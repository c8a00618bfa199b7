"""A worker: a process that runs jobs until it is stopped or its server ends.

The settings arrive as one line of JSON on standard input, so that no list of processes shows the database's password.
The end of that input means that the server has ended: the worker then returns its jobs, as on SIGTERM.
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
from mdrive_sumo.core.terminal import CleanFormatter
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.prepared_run import compute_job_limit_s
from server.clock import now_us
from server.errors import new_id
from server.evaluation.cross_play import JUDGED_EPISODES
from server.evaluation.dispatcher import Dispatcher, StopRequest
from server.evaluation.job_task import JobResult, JobTask
from server.evaluation.machine_check import check_hidden_phases, check_machine
from server.evaluation.submission_job import run_submission_job
from server.phase_suites import LoadedPhaseSuites
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, phases
from server.store.tables import PhaseRow

LOG = logging.getLogger("mdrive.worker")
NICE = 5
"""Niceness of workers: requests to the server have priority."""


def main(function: Callable[[JobTask], JobResult] = run_submission_job, clock: Callable[[], int] = now_us) -> int:
    """Run `python -m server.evaluation.worker`; return exit code 0 if it was stopped, 2 for unusable input."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(CleanFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    stop = StopRequest()
    stop.install_signal_handlers()
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
    """Run queued jobs in one child process, or on the workers of a Dask cluster.

    Raises InputError if this machine is not suitable, StoreUnavailable.
    """
    check_machine(settings)
    work = settings.work
    store = Store(settings.database_url)
    try:
        with store.read() as session:
            check_hidden_phases(settings, session, clock())
        suites = LoadedPhaseSuites(settings)
        limit_s = _compute_limit_s(store, settings, suites, clock())
        with make_executor(function, 1, limit_s, work.scheduler) as executor:
            Dispatcher(store, settings, suites, executor, make_owner(), clock).run(stop)
    finally:
        store.close()


def make_owner() -> str:
    """Return a name that no other process has or had."""
    return f"{socket.gethostname()[:24]}.{os.getpid()}.{new_id()[:12]}"


def _compute_limit_s(store: Store, settings: ServerSettings, suites: LoadedPhaseSuites, at_us: int) -> float:
    """Return the wall time after which a job counts as hanging [s]: more than its agents may take together.

    It reads all suites, which must not happen in the transaction of the first claim. Raises InputError for the
    unreadable suite of a phase that is not over.
    """
    with store.read() as session:
        every = phases.list_phases(session)
    egos = [count for phase in every for count in _count_egos(phase, suites, at_us)]
    limits = settings.sandbox.line_limits()
    episodes = JUDGED_EPISODES if any(phase.cross_play_scenarios for phase in every) else 1
    return compute_job_limit_s(max(egos, default=1), (limits,), limits.pace_s, episodes)


def _count_egos(phase: PhaseRow, suites: LoadedPhaseSuites, at_us: int) -> list[int]:
    """Return the number of CAVs of each scenario; [] for a phase that is over and whose suite is gone."""
    try:
        return [len(scenario.egos) for scenario in suites.suite(phase).scenarios]
    except InputError as error:
        if at_us < phase.closes_us:
            raise
        LOG.warning("phase %s, which is over: its jobs can no longer be run: %s", phase.id, error)
        return []


def _read_line(fd: int) -> bytes:
    """Read one line and no byte more: `_stop_on_eof` waits for the rest."""
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
            stop.request()
            return


if __name__ == "__main__":
    sys.exit(main())
