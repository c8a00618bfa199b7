"""The dispatcher: claims jobs, submits them to an executor, prolongs their leases, and writes each result once.

It is a worker's main loop; the executor is one local process or a cluster. Killing it at any moment neither loses nor
duplicates a result, because the database decides.
"""

import logging
import shutil
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy.orm import Session

from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.worker_process import WorkerFailure, describe_write_error
from server.clock import now_us
from server.enums import ScenarioVerdict
from server.evaluation import spot_checks
from server.evaluation.cross_play_work import CROSS_PLAY_PREFIX, CrossPlayWork
from server.evaluation.disk_space import has_disk_space
from server.evaluation.job_task import AgentRejection, EvaluatorMismatchError, JobResult, JobTask, load_task, move_files
from server.evaluation.phase_separation import CLAIMED, PhaseSeparation
from server.evaluation.stop_request import StopRequest
from server.evaluation.write_summaries import write_left_over_summaries, write_summary
from server.phase_suites import PhaseSuites
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, audit, jobs, phases, submissions, workers
from server.store.jobs import JobOutcome
from server.store.tables import JobRow

LOG = logging.getLogger("mdrive.worker")
SECOND_US = 1_000_000
IDLE_S = 1.0
"""Pause between queries of an idle worker [s]."""
MAX_PAUSE_S = 60.0
DISK_FULL_PAUSE_S = 10.0
SPOT_CHECK_PREFIX = "spot-"


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
        self._spot_checks: deque[int] = deque()
        self._separation = PhaseSeparation(settings.work.phase_kinds, settings.data, settings.work.drop_caches)
        self._cross_play = CrossPlayWork(store, settings, suites, owner, clock)
        self._failed_in_a_row, self._resume_us = 0, 0
        self._seen_us: int | None = None

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
            write_left_over_summaries(self._store, self._clock, self._draw_spot_checks)
            self._cross_play.plan()
            self._seen_us = now

    def _claim(self) -> None:
        while self._clock() >= self._resume_us and self._executor.free_slots > 0:
            if self._spot_checks:  # before new jobs: a queue that is never empty must not delay them for ever
                if not self._start_spot_check():
                    return
            elif self._has_queued_job():
                if not (self._has_disk_space() and self._claim_one()):
                    return
            elif not self._cross_play.start_one(self._separation, self._executor):  # only while nothing else waits
                return

    def _has_disk_space(self) -> bool:
        if has_disk_space(self._settings.data):
            return True
        self._resume_us = self._clock() + int(DISK_FULL_PAUSE_S * SECOND_US)
        return False

    def _has_queued_job(self) -> bool:
        with self._store.read() as session:
            return jobs.is_any_waiting(session, self._clock())

    def _claim_one(self) -> bool:
        now = self._clock()
        try:
            with self._store.write() as session:
                job = self._separation.claim(
                    session, lambda public: jobs.claim(session, self._owner, self._lease_us, now, public), now
                )
                if job is None:
                    return False
                ours = self._has_our_evaluator(session, job)
                task = load_task(session, job, self._settings, self._suites) if ours else None
                if task is None:
                    jobs.release(session, job.id, self._owner, job.attempt)
        except Exception:
            self._separation.end(CLAIMED)
            raise
        if task is None:
            self._separation.end(CLAIMED)
            raise EvaluatorMismatchError(
                f"submission {job.submission}: expected this worker's code, suite, sandbox and environment, found"
                " another evaluator's; restart the server, which queues it anew"
            )
        key = f"{task.job}.{task.attempt}"
        self._separation.rename(CLAIMED, key)
        self._held[key] = _HeldJob(task, now)
        self._executor.submit(key, task)
        return True

    def _has_our_evaluator(self, session: Session, job: JobRow) -> bool:
        submission = submissions.get(session, job.submission)
        phase = phases.get(session, submission.phase)
        return submission.evaluator == self._suites.evaluator(phase, submission.environment)

    def _prolong_leases(self) -> None:
        now = self._clock()
        self._cross_play.prolong(self._executor, self._separation)
        due = [key for key, held in self._held.items() if now - held.beat_us >= self._beat_us]
        if not due:
            return
        waiting = {key for key, _ in self._unwritten}
        with self._store.write() as session:
            for submission in {self._held[key].task.submission for key in due}:
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
        if key.startswith(SPOT_CHECK_PREFIX):
            self._separation.end(key)
            spot_checks.record_outcome(self._store, int(key.removeprefix(SPOT_CHECK_PREFIX)), outcome, self._clock())
            return
        if key.startswith(CROSS_PLAY_PREFIX):
            if self._cross_play.finish(key, outcome, self._separation):
                self._pause()
            return
        if key not in self._held:
            return
        task = self._held[key].task
        if isinstance(outcome, WorkerFailure):
            outcome = JobOutcome(ScenarioVerdict.FAILED_OURS, None, failure=f"{outcome.kind}: {outcome.reason}")
        if isinstance(outcome, AgentRejection):
            self._reject(task, outcome)
        else:
            self._finish(task, outcome)
        self._pause_after(task, outcome)  # once, when the result is written
        self._drop(key)

    def _finish(self, task: JobTask, outcome: JobOutcome) -> None:
        try:
            self._write_outcome(task, outcome)
        except OSError as error:
            why = f"the files of a result: {describe_write_error(error, error.filename)}"
            self._write_outcome(task, JobOutcome(ScenarioVerdict.FAILED_OURS, None, failure=why))

    def _write_outcome(self, task: JobTask, outcome: JobOutcome) -> None:
        now = self._clock()
        complete = False
        with self._store.write() as session:
            counted = jobs.finish(session, task.job, self._owner, task.attempt, outcome, now)
            if counted and outcome.verdict is not ScenarioVerdict.FAILED_OURS:
                move_files(task)  # before the commit: a committed result has its files
                complete = submissions.is_complete(session, task.submission)
                if not complete:
                    submissions.end_if_over_budget(session, task.submission, self._settings.work.job_budget_us, now)
        if not counted:
            LOG.info("job %d: result of attempt %d dropped: the lease had ended", task.job, task.attempt)
        if complete:
            self._try(lambda: write_summary(self._store, task.submission, self._clock, self._draw_spot_checks))

    def _draw_spot_checks(self, session: Session, submission: str) -> None:
        draw = audit.find_head(session)
        if spot_checks.is_drawn(draw, self._settings.work.spot_check):
            self._spot_checks.extend(job.id for job in spot_checks.sample_jobs(session, submission, draw))

    def _reject(self, task: JobTask, rejection: AgentRejection) -> None:
        now = self._clock()
        with self._store.write() as session:
            if self._prolong(session, task, now):
                submissions.reject(session, task.submission, rejection.why, now)

    def _pause_after(self, task: JobTask, outcome: JobResult) -> None:
        if isinstance(outcome, JobOutcome) and outcome.verdict is ScenarioVerdict.FAILED_OURS:
            LOG.error("job %d, attempt %d: %s", task.job, task.attempt, outcome.failure)
            self._pause()
        else:
            self._failed_in_a_row = 0

    def _pause(self) -> None:
        """Pause after a failure on our side: a broken machine must not fail all submissions at full speed."""
        pause_s = min(2.0 ** min(self._failed_in_a_row, 10), MAX_PAUSE_S)  # bounds the exponent
        self._failed_in_a_row += 1
        self._resume_us = self._clock() + int(pause_s * SECOND_US)

    def _start_spot_check(self) -> bool:
        """Start the first; return False while the other kind of phases has this host."""
        task = spot_checks.make_check_task(self._store, self._spot_checks[0], self._settings, self._suites)
        key = f"{SPOT_CHECK_PREFIX}{task.job}"
        if not self._separation.try_begin(key, task.public, self._clock()):
            return False
        self._spot_checks.popleft()
        self._executor.submit(key, task)
        return True

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
        self._try(lambda: self._cross_play.release(self._executor, self._separation))
        for key in tuple(self._held):
            self._drop(key)
