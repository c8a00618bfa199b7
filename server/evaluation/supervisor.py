"""The supervisor: starts the workers of a server, starts dead ones again, clears up, and stops them in the end."""

import json
import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from sqlalchemy import select

from server.clock import now_us
from server.evaluation.archive_cache import delete_stale
from server.evaluation.machine_check import check_machine
from server.evaluation.requeue import requeue_outdated
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, quota, retention
from server.store.tables import SubmissionRow

LOG = logging.getLogger("mdrive.supervisor")
COMMAND = (sys.executable, "-P", "-m", "server.evaluation.worker")
POLL_S = 0.5
STEADY_S = 60.0
"""A worker that lived so long did not die of what it was started with."""
MAX_PAUSE_S = 30.0
STOPPING_S = 15.0
CLEANUP_S = 3600.0


@dataclass(slots=True)
class _WorkerSlot:
    """Of one worker, and of those after it."""

    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    deaths: int = 0
    """In a row, each soon after its start."""
    next_s: float = field(default=0.0)


class Supervisor:
    """Of one `serve`. `start` and `stop` belong to whoever owns it; in between it lives in a thread of its own."""

    def __init__(
        self,
        store: Store,
        settings: ServerSettings,
        command: Sequence[str] = COMMAND,
        clock: Callable[[], int] = now_us,
    ) -> None:
        self._store, self._settings, self._command, self._clock = store, settings, tuple(command), clock
        work = settings.work
        self._places = [_WorkerSlot() for _ in range(1 if work.scheduler else work.processes)]
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)
        self._tidy_s = 0.0

    def start(self) -> None:
        """Begins. Raises InputError where this machine cannot keep agents in as the settings demand."""
        if self._places:
            check_machine(self._settings)
        if count := requeue_outdated(self._store, self._settings, self._clock()):
            LOG.warning("%d unfinished submissions begin anew under this version", count)
        self._thread.start()

    def stop(self) -> None:
        """Workers give their jobs back and end; those that do not are killed, and their leases end by themselves."""
        self._stopping.set()
        self._thread.join()
        processes = [place.process for place in self._places if place.process is not None]
        for process in processes:
            process.terminate()
        deadline_s = time.monotonic() + STOPPING_S
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline_s - time.monotonic()))
            process.kill()
            process.wait()
            _close_stdin(process)

    @property
    def pids(self) -> list[int]:
        """Of workers that live now: for health and metrics."""
        return [p.process.pid for p in self._places if p.process is not None and p.process.poll() is None]

    def _watch(self) -> None:
        while not self._stopping.is_set():
            for place in self._places:
                self._look_at(place, time.monotonic())
            if time.monotonic() >= self._tidy_s:
                self._tidy_s = time.monotonic() + CLEANUP_S
                self._clear_up()
            self._stopping.wait(POLL_S)

    def _look_at(self, place: _WorkerSlot, now_s: float) -> None:
        process = place.process
        if process is not None:
            if process.poll() is None:
                return
            place.deaths = 0 if now_s - place.started_s > STEADY_S else place.deaths + 1
            pause_s = min(0.5 * 2.0**place.deaths, MAX_PAUSE_S)
            LOG.error("worker %d ended with code %s; another one in %.0f s", process.pid, process.returncode, pause_s)
            _close_stdin(process)
            place.process, place.next_s = None, now_s + pause_s
        if now_s >= place.next_s:
            self._start_one(place, now_s)

    def _start_one(self, place: _WorkerSlot, now_s: float) -> None:
        try:
            place.process, place.started_s = self._started(), now_s
        except OSError as error:  # of the machine, for now: no memory, too many processes
            place.next_s = now_s + MAX_PAUSE_S
            LOG.error("a worker cannot be started: %s; tried again in %.0f s", error, MAX_PAUSE_S)

    def _started(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(self._command, stdin=subprocess.PIPE)  # ended in `stop`, or by our own death
        assert process.stdin is not None
        line = json.dumps(self._settings.model_dump(mode="json")).encode() + b"\n"
        with suppress(BrokenPipeError):  # dead already: seen with the next look
            process.stdin.write(line)
            process.stdin.flush()
        return process

    def _clear_up(self) -> None:
        """By the policy of the settings; whatever fails is tried again in an hour."""
        try:
            with self._store.read() as session:
                kept = retention.select_retained(session, self._settings.keep.policy(), self._clock())
                unfinished = select(SubmissionRow.archive_sha256).where(SubmissionRow.state.in_(quota.UNFINISHED))
                needed = set(session.scalars(unfinished))
            retention.delete_expired(kept, self._settings.data, self._clock())
            delete_stale(self._settings.data, needed)
        except (StoreUnavailable, OSError) as error:
            LOG.warning("nothing was cleared up: %s", error)


def _close_stdin(process: subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()
