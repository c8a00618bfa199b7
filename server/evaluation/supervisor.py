"""The supervisor: starts the workers of a server, restarts dead ones, deletes old files, and stops the workers.

Before that it restarts unfinished submissions of another evaluator, so that no result mixes two.
"""

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
from sqlalchemy.orm import Session

from mdrive_sumo.agent_process.sandbox.cgroups import remove_dead_episode_groups
from mdrive_sumo.agent_process.sandbox.private_files import remove_idle_files
from mdrive_sumo.core.errors import InputError
from server.clock import now_us
from server.enums import JobKind, JobState
from server.evaluation.archive_cache import delete_stale
from server.evaluation.machine_check import check_hidden_phases, check_machine
from server.evaluation.phase_separation import describe_mixed_phases
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, jobs, phases, quota, retention, submissions
from server.store.tables import JobRow, SubmissionRow

LOG = logging.getLogger("mdrive.supervisor")
COMMAND = (sys.executable, "-P", "-m", "server.evaluation.worker")
POLL_S = 0.5
"""Pause between two looks at the workers [s]."""
STEADY_S = 60.0
"""Age at which a worker's death is no longer counted as a failed start [s]."""
MAX_PAUSE_S = 30.0
"""Longest pause before a worker is started again, which doubles from 1 s on with each death soon after a start [s]."""
STOPPING_S = 15.0
"""Time that workers have to return their jobs when the server stops [s]; a box ends within 1 s of its worker."""
CLEANUP_S = 3600.0
"""Time between two looks for old files [s]."""


@dataclass(slots=True)
class _WorkerSlot:
    """Slot of one worker and its successors."""

    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    deaths: int = 0
    """Consecutive deaths soon after the start."""
    next_s: float = field(default=0.0)


class Supervisor:
    """Runs in a thread between `start` and `stop`."""

    def __init__(
        self,
        store: Store,
        settings: ServerSettings,
        command: Sequence[str] = COMMAND,
        clock: Callable[[], int] = now_us,
    ) -> None:
        self._store, self._settings, self._command, self._clock = store, settings, tuple(command), clock
        work = settings.work
        self._slots = [_WorkerSlot() for _ in range(1 if work.scheduler else work.processes)]
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="supervisor", daemon=True)
        self._cleanup_s = 0.0

    def start(self) -> None:
        """Start. Raises InputError if this machine cannot sandbox agents as the settings require."""
        if self._slots:
            check_machine(self._settings)
            with self._store.read() as session:
                check_hidden_phases(self._settings, session, self._clock())
            self._warn_of_mixed_phases()
        if count := requeue_outdated(self._store, self._settings, self._clock()):
            LOG.warning("%d unfinished submissions restart under this version", count)
        self._thread.start()

    def _warn_of_mixed_phases(self) -> None:
        with self._store.read() as session:
            publics = frozenset(phase.public for phase in phases.list_phases(session))
        if warning := describe_mixed_phases(self._settings.work.phase_kinds, publics):
            LOG.warning("%s", warning)

    def stop(self) -> None:
        """Terminate the workers, which return their jobs; kill those that do not end, whose leases then expire."""
        self._stopping.set()
        self._thread.join()
        processes = [slot.process for slot in self._slots if slot.process is not None]
        for process in processes:
            process.terminate()
        deadline_s = time.monotonic() + STOPPING_S
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline_s - time.monotonic()))
            process.kill()
            process.wait()
            _close_stdin(process)
        if (copies := self._settings.sandbox.copies_folder()) is not None:
            remove_idle_files(copies)
        remove_dead_episode_groups()

    @property
    def pids(self) -> list[int]:
        """Process ids of live workers."""
        return [p.process.pid for p in self._slots if p.process is not None and p.process.poll() is None]

    def _watch(self) -> None:
        while not self._stopping.is_set():
            for slot in self._slots:
                self._check_slot(slot, time.monotonic())
            if time.monotonic() >= self._cleanup_s:
                self._cleanup_s = time.monotonic() + CLEANUP_S
                self._delete_old_files()
            self._stopping.wait(POLL_S)

    def _check_slot(self, slot: _WorkerSlot, now_s: float) -> None:
        process = slot.process
        if process is not None:
            if process.poll() is None:
                return
            slot.deaths = 0 if now_s - slot.started_s > STEADY_S else slot.deaths + 1
            pause_s = min(0.5 * 2.0**slot.deaths, MAX_PAUSE_S)
            LOG.error("worker %d ended with code %s; restart in %.0f s", process.pid, process.returncode, pause_s)
            _close_stdin(process)
            slot.process, slot.next_s = None, now_s + pause_s
        if now_s >= slot.next_s:
            self._start_worker(slot, now_s)

    def _start_worker(self, slot: _WorkerSlot, now_s: float) -> None:
        try:
            slot.process, slot.started_s = self._start_process(), now_s
        except OSError as error:  # temporary: no memory, too many processes
            slot.next_s = now_s + MAX_PAUSE_S
            LOG.error("a worker cannot be started: %s; next attempt in %.0f s", error, MAX_PAUSE_S)

    def _start_process(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE
        )  # ended in `stop`, or when our end closes its input
        assert process.stdin is not None
        line = json.dumps(self._settings.model_dump(mode="json")).encode() + b"\n"
        with suppress(BrokenPipeError):  # already dead: found by the next check
            process.stdin.write(line)
            process.stdin.flush()
        return process

    def _delete_old_files(self) -> None:
        """Delete old files by the policy of the settings; a failure is tried again in an hour."""
        try:
            with self._store.read() as session:
                kept = retention.select_retained(session, self._settings.keep.policy(), self._clock())
                unfinished = select(SubmissionRow.archive_sha256).where(SubmissionRow.state.in_(quota.UNFINISHED))
                needed = set(session.scalars(unfinished))
            retention.delete_expired(kept, self._settings.data, self._clock())
            delete_stale(self._settings.data, needed)
            retention.delete_expired_rows(self._store, self._settings.keep.policy(), self._clock())
        except (StoreUnavailable, OSError) as error:
            LOG.warning("old files were not deleted: %s", error)


def _close_stdin(process: subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()


def requeue_outdated(store: Store, settings: ServerSettings, now_us: int, suites: PhaseSuites | None = None) -> int:
    """Restart unfinished submissions of another evaluator with the present jobs of their suites; return how many.

    A worker that still runs an old job loses it with its next heartbeat. Submissions that can no longer be run fail on
    our side; their spot checks and cross-play are cancelled. Only `serve` calls this, at its start.
    """
    suites = suites or LoadedPhaseSuites(settings)
    count = 0
    with store.write() as session:
        for submission in session.scalars(select(SubmissionRow).where(SubmissionRow.state.in_(quota.UNFINISHED))).all():
            phase = phases.get(session, submission.phase)
            try:
                evaluator, planned = suites.evaluator(phase, submission.environment), suites.jobs(phase)
            except InputError as error:  # the suite of a closed phase: for open phases the server has refused to start
                LOG.error("submission %s can no longer be run: %s", submission.id, error)
                submissions.fail(session, submission.id, "the suite of its phase can no longer be run", now_us)
                continue
            if submission.evaluator != evaluator:
                submissions.renew(session, submission, evaluator, planned, now_us)
                count += 1
        _cancel_unreadable(session, suites, now_us)
    return count


def _cancel_unreadable(session: Session, suites: PhaseSuites, now_us: int) -> None:
    """Cancel queued spot checks and cross-play whose suite or environment cannot be read any more."""
    of_kind = (JobRow.kind != JobKind.SUBMISSION, JobRow.state == JobState.QUEUED)
    waiting = session.scalars(select(JobRow).where(*of_kind)).all()
    unreadable: set[str] = set()
    for name in sorted({name for job in waiting for name in (job.submission, job.others)}):
        submission = submissions.get(session, name)
        try:
            suites.evaluator(phases.get(session, submission.phase), submission.environment)
        except InputError as error:
            LOG.warning("submission %s: its spot checks and cross-play are cancelled: %s", name, error)
            unreadable.add(name)
    for job in waiting:
        if {job.submission, job.others} & unreadable:
            jobs.cancel(session, job.id, now_us)
