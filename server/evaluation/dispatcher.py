"""The dispatcher: claims jobs, submits them to an executor, prolongs their leases, and writes each result once.

It is a worker's main loop, for jobs of every kind; the executor is one local process or a cluster. Killing it at any
moment neither loses nor duplicates a result, because the database decides.
"""

import logging
import os
import shutil
import signal
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import FrameType

from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.worker_process import WorkerFailure, describe_write_error
from mdrive_sumo.scoring import ScenarioResult
from server.clock import now_us
from server.enums import JobKind
from server.evaluation import spot_checks
from server.evaluation.cross_play import compute_score, plan_pairs
from server.evaluation.job_task import (
    BY_MESSAGES,
    AgentRejection,
    EvaluatorMismatchError,
    JobResult,
    JobTask,
    describe_failure,
    load_task,
    move_files,
)
from server.evaluation.phase_separation import CLAIMED, PhaseSeparation
from server.evaluation.summary import write_left_over_summaries, write_summary
from server.phase_suites import PhaseSuites
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, cross_play, jobs, submissions, workers
from server.store.jobs import JobOutcome
from server.store.tables import JobRow


class StopRequest:
    """Its `fd` becomes readable with the request; `request` is safe in signal handlers and other threads."""

    def __init__(self) -> None:
        self.fd, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self.is_requested = False

    def request(self) -> None:
        """Request the end."""
        self.is_requested = True
        with suppress(BlockingIOError):
            os.write(self._writing, b".")

    def install_signal_handlers(self) -> None:
        """Make SIGTERM and SIGINT request the end."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def close(self) -> None:
        """Close the pipe."""
        os.close(self.fd)
        os.close(self._writing)

    def _on_signal(self, _: int, __: FrameType | None) -> None:
        self.request()


LOG = logging.getLogger("mdrive.worker")
SECOND_US = 1_000_000
IDLE_S = 1.0
"""Pause between queries of an idle worker [s]; chosen: short beside a scenario, which takes many seconds."""
MAX_PAUSE_S = 60.0
"""Longest pause after failures on our side in a row, which doubles from 1 s on [s]."""
DISK_FULL_PAUSE_S = 10.0
"""Pause until the next look at a disk without room [s]."""
MIN_FREE_BYTES = 64 * 2**20
"""Free disk space without which no job is claimed [bytes]: results that cannot be written count as our failures."""


@dataclass(slots=True)
class _HeldJob:
    task: JobTask
    beat_us: int
    """Time of the last heartbeat [us]."""


class Dispatcher:
    """Works in the thread that created the executor."""

    def __init__(
        self,
        store: Store,
        settings: ServerSettings,
        suites: PhaseSuites,
        executor: Executor[JobTask, JobResult],
        owner: str,
        clock: Callable[[], int] = now_us,
    ) -> None:
        """`owner`: a name that no other process has or had."""
        self._store, self._settings, self._suites, self._executor = store, settings, suites, executor
        self._owner, self._clock = owner, clock
        self._held: dict[str, _HeldJob] = {}
        self._unwritten: deque[tuple[str, JobResult | WorkerFailure]] = deque()
        self._separation = PhaseSeparation(settings.work.phase_kinds, settings.data, settings.work.drop_caches)
        self._failed_in_a_row, self._resume_us = 0, 0
        self._seen_us: int | None = None
        self._unplanned: set[str] = set()

    def run(self, stop: StopRequest) -> None:
        """Work until stopped; jobs under way then return to the queue without counting as failures.

        Raises InputError if it cannot continue: another evaluator is needed, or the cluster is lost.
        """
        try:
            while not stop.is_requested:
                self.step(IDLE_S, stop)
        finally:
            self._release_all()
            self._separation.close()

    def step(self, wait_s: float, stop: StopRequest) -> None:
        """Claim jobs, wait at most `wait_s` for results, write them, prolong leases.

        A claim also ends expired leases. After an outage of the database our own may have expired, so results are
        written and leases prolonged before anything is claimed.
        """
        self._try(self._sign_in)
        there = self._write_results() and self._try(self._prolong_leases) and self._try(self._claim)
        if self._held and there:
            due_us = min(held.beat_us for held in self._held.values()) + self._beat_us
            wait_s = max(0.0, min(wait_s, (due_us - self._clock()) / SECOND_US))
        self._unwritten.extend(self._executor.collect_outcomes(wait_s, [stop.fd]))
        self._write_results()
        self._try(self._prolong_leases)

    def _write_results(self) -> bool:
        """Write finished results; return whether all are written."""
        while self._unwritten and self._try(lambda: self._handle_outcome(*self._unwritten[0])):
            self._unwritten.popleft()
        return not self._unwritten

    @property
    def _beat_us(self) -> int:
        return self._settings.work.heartbeat_s * SECOND_US

    @property
    def _lease_us(self) -> int:
        return self._settings.work.lease_s * SECOND_US

    def _try(self, action: Callable[[], None]) -> bool:
        """Run an action; return False if the database is unavailable: the next step tries again."""
        try:
            action()
        except StoreUnavailable as error:
            LOG.warning("%s; trying again", error)
            return False
        return True

    def _sign_in(self) -> None:
        """Record a heartbeat, so that an admin sees that this process is alive."""
        now = self._clock()
        if self._seen_us is None or now - self._seen_us >= self._beat_us:
            with self._store.write() as session:
                workers.record_heartbeat(session, self._owner, self._settings.work.scheduler, now)
            write_left_over_summaries(self._store, self._clock, self._plan_check)
            plan_pairs(self._store, self._suites, self._unplanned)
            self._seen_us = now

    def _claim(self) -> None:
        while self._clock() >= self._resume_us and self._executor.free_slots > 0:
            if not (self._is_any_waiting() and self._has_disk_space() and self._claim_one()):
                return

    def _is_any_waiting(self) -> bool:
        with self._store.read() as session:
            return jobs.is_any_waiting(session, self._clock())

    def _has_disk_space(self) -> bool:
        """Return whether the data folder has room for a result; if not, pause. Raises InputError for no folder."""
        data = self._settings.data
        try:
            free = shutil.disk_usage(data).free
        except OSError as error:
            raise InputError(f"data: expected a folder {data}, found none ({error.strerror})") from None
        if free >= MIN_FREE_BYTES:
            return True
        wanted, found = MIN_FREE_BYTES // 2**20, free // 2**20
        LOG.error("%s: expected %d MiB free, found %d: nothing new is begun", data, wanted, found)
        self._resume_us = self._clock() + int(DISK_FULL_PAUSE_S * SECOND_US)
        return False

    def _claim_one(self) -> bool:
        now = self._clock()
        try:
            with self._store.write() as session:
                job = self._separation.claim(
                    session, lambda public: jobs.claim(session, self._owner, self._lease_us, now, public), now
                )
                if job is None:
                    return False
                found = self._load(session, job, now)
        except Exception:
            self._separation.end(CLAIMED)
            raise
        if not isinstance(found, JobTask):
            self._separation.end(CLAIMED)
            if found is not None:
                raise found
            return True
        key = f"{found.job}.{found.attempt}"
        self._separation.rename(CLAIMED, key)
        self._held[key] = _HeldJob(found, now)
        self._executor.submit(key, found)
        return True

    def _load(self, session: Session, job: JobRow, now: int) -> JobTask | EvaluatorMismatchError | None:
        """Return the task of a claimed job; None if the job is given up; an error to raise once the job is put back."""
        try:
            task = load_task(session, job, self._settings, self._suites)
        except InputError as error:  # it must not stop all other jobs: this one would be the next of every worker
            self._decline_unreadable(session, job, str(error), now)
            return None
        if task is not None:
            return task
        if job.kind != JobKind.SUBMISSION:
            self._decline(session, job, spot_checks.NOT_COMPARED if job.kind == JobKind.SPOT_CHECK else "", now)
            return None
        jobs.release(session, job.id, self._owner, job.attempt)
        return EvaluatorMismatchError(
            f"submission {job.submission}: expected this worker's code, suite, sandbox and environment, found"
            " another evaluator's; restart the server, which queues it anew"
        )

    def _decline_unreadable(self, session: Session, job: JobRow, why: str, now: int) -> None:
        """Give up a job whose suite or environment cannot be read; for a submission it is a failure on our side."""
        if job.kind != JobKind.SUBMISSION:
            self._decline(session, job, f"its {job.kind} job is cancelled: {why}", now)
            return
        LOG.error("%s job %d, attempt %d: %s", job.kind, job.id, job.attempt, why)
        jobs.record_failure(session, job.id, self._owner, job.attempt, why, now)
        self._pause()

    def _decline(self, session: Session, job: JobRow, why: str, now: int) -> None:
        """Cancel a job that is no submission's: pairs are planned anew once they can be driven, checks are left out."""
        if why:
            LOG.warning("submission %s: %s", job.submission, why)
        jobs.cancel(session, job.id, now)

    def _prolong_leases(self) -> None:
        now = self._clock()
        due = [key for key, held in self._held.items() if now - held.beat_us >= self._beat_us]
        if not due:
            return
        waiting = {key for key, _ in self._unwritten}
        with self._store.write() as session:
            tasks = [self._held[key].task for key in due]
            for submission in {task.submission for task in tasks if task.kind is JobKind.SUBMISSION}:
                submissions.end_if_over_budget(session, submission, self._settings.work.job_budget_us, now)
            lost = [key for key in due if not self._prolong(session, self._held[key].task, now)]
        for key in due:
            self._held[key].beat_us = now
        for key in {*lost} - waiting:
            self._executor.cancel(key)
            self._drop(key)

    def _prolong(self, session: Session, task: JobTask, now: int) -> bool:
        return jobs.heartbeat(session, task.job, self._owner, task.attempt, self._lease_us, now)

    def _handle_outcome(self, key: str, outcome: JobResult | WorkerFailure) -> None:
        if key not in self._held:
            return
        task = self._held[key].task
        if (failure := describe_failure(outcome)) is not None:
            self._record_failure(task, failure)
        else:
            assert not isinstance(outcome, WorkerFailure), "a failure on our side"
            try:
                self._write_outcome(task, outcome)
            except OSError as error:
                self._record_failure(task, f"the files of a result: {describe_write_error(error, error.filename)}")
            else:
                self._failed_in_a_row = 0
        self._drop(key)

    def _record_failure(self, task: JobTask, failure: str) -> None:
        with self._store.write() as session:
            jobs.record_failure(session, task.job, self._owner, task.attempt, failure, self._clock())
        LOG.error("%s job %d, attempt %d: %s", task.kind, task.job, task.attempt, failure)
        self._pause()  # once, when the failure is written

    def _write_outcome(self, task: JobTask, outcome: JobResult) -> None:
        """Write what is no failure on our side. Raises StoreUnavailable, or OSError for files: nothing is written."""
        if task.kind is JobKind.SPOT_CHECK:
            self._write_check(task, outcome)
        elif isinstance(outcome, AgentRejection):
            self._reject(task, outcome)
        elif task.kind is JobKind.CROSS_PLAY:
            by_messages = bool((outcome.usage or {}).get(BY_MESSAGES))
            score = compute_score(ScenarioResult.model_validate(outcome.result), by_messages=by_messages)
            with self._store.write() as session:
                cross_play.finish(session, task.job, self._owner, task.attempt, score, self._clock())
        else:
            self._write_result(task, outcome)

    def _write_check(self, task: JobTask, outcome: JobResult) -> None:
        now = self._clock()
        with self._store.write() as session:
            if jobs.end(session, task.job, self._owner, task.attempt, None, now) is not None:
                spot_checks.record_outcome(session, task, outcome, now)

    def _reject(self, task: JobTask, rejection: AgentRejection) -> None:
        """Reject the submission; of a pair neither team is blamed, since it is not known which of the two it was."""
        now = self._clock()
        with self._store.write() as session:
            if task.kind is JobKind.CROSS_PLAY:
                why = f"one of the agents was rejected: {rejection.why}"
                jobs.give_up(session, task.job, self._owner, task.attempt, why, now)
            elif self._prolong(session, task, now):
                submissions.reject(session, task.submission, rejection.why, now)

    def _write_result(self, task: JobTask, outcome: JobOutcome) -> None:
        now = self._clock()
        complete = False
        with self._store.write() as session:
            counted = jobs.finish(session, task.job, self._owner, task.attempt, outcome, now)
            if counted:
                move_files(task)  # before the commit: a committed result has its files
                complete = submissions.is_complete(session, task.submission)
                if not complete:
                    submissions.end_if_over_budget(session, task.submission, self._settings.work.job_budget_us, now)
        if not counted:
            LOG.info("job %d: result of attempt %d dropped: the lease had ended", task.job, task.attempt)
        if complete:
            self._try(lambda: write_summary(self._store, task.submission, self._clock, self._plan_check))

    def _plan_check(self, session: Session, submission: str) -> None:
        spot_checks.plan_check(session, submission, self._settings.work.spot_check)

    def _pause(self) -> None:
        """Pause after a failure on our side: a broken machine must not fail all submissions at full speed."""
        pause_s = min(2.0 ** min(self._failed_in_a_row, 10), MAX_PAUSE_S)  # bounds the exponent
        self._failed_in_a_row += 1
        self._resume_us = self._clock() + int(pause_s * SECOND_US)

    def _drop(self, key: str) -> None:
        self._separation.end(key)
        shutil.rmtree(self._held.pop(key).task.stage, ignore_errors=True)

    def _release_all(self) -> None:
        """Return all jobs to the queue and sign out; if the database is unavailable the leases expire."""

        def release() -> None:
            with self._store.write() as session:
                for held in self._held.values():
                    jobs.release(session, held.task.job, self._owner, held.task.attempt)
                workers.remove_worker(session, self._owner)

        for key in self._held:
            self._executor.cancel(key)
        self._try(release)
        for key in tuple(self._held):
            self._drop(key)
