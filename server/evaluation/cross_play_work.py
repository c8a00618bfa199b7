"""Cross-play on the server: plans, claims and finishes jobs while no job of a submission waits.

The time of these jobs is charged to no team: the organiser asked for them. All pairs take turns.
"""

import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy.orm import Session

from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.worker_process import WorkerFailure
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.metrics.endings import AGENT_FAILED_FACTOR
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, compute_mean
from server.enums import ChallengeTrack, ScenarioVerdict
from server.evaluation.job_task import BY_MESSAGES, AgentRejection, JobResult, JobTask, OtherArchive
from server.evaluation.phase_separation import PhaseSeparation
from server.phase_suites import PhaseSuites
from server.settings import ServerSettings
from server.store import Store, cross_play, phases, standings, submissions
from server.store.cross_play import CrossPlayScore
from server.store.tables import CrossPlayJobRow, PhaseRow, SubmissionRow

LOG = logging.getLogger("mdrive.worker")
CROSS_PLAY_PREFIX = "cross-play-"
SECOND_US = 1_000_000
FAILED = "agent-failed"


@dataclass(slots=True)
class _HeldPair:
    task: JobTask
    beat_us: int


class CrossPlayWork:
    """The part of a worker that drives agents among each other."""

    def __init__(
        self, store: Store, settings: ServerSettings, suites: PhaseSuites, owner: str, clock: Callable[[], int]
    ) -> None:
        self._store, self._settings, self._suites = store, settings, suites
        self._owner, self._clock = owner, clock
        self._held: dict[str, _HeldPair] = {}

    def plan(self) -> None:
        """Add the jobs of new pairs in every phase with a board of cross-play. Raises StoreUnavailable."""
        with self._store.read() as session:
            wanted = [phase.id for phase in phases.list_phases(session) if phase.cross_play_scenarios]
        for name in wanted:
            with self._store.read() as session:
                is_due = self._plan_phase(session, name, cross_play.list_missing)
            if is_due:
                with self._store.write() as session:
                    count = self._plan_phase(session, name, cross_play.plan)
                LOG.info("phase %s: %s jobs of cross-play added", name, count)

    def _plan_phase(self, session: Session, name: str, act: Callable[..., object]) -> object:
        """Return what `act` returns for the agents of a phase that this worker can drive; None without two."""
        phase = phases.get(session, name)
        listed = cross_play.list_agents(session, name)
        rows = [(entry, submissions.get(session, str(entry.submission))) for entry in listed]
        ours = [(entry, row) for entry, row in rows if self._is_ours(phase, row)]
        if len(ours) < 2:
            return None
        return act(session, phase, [entry for entry, _ in ours], standings.evaluator_digest(ours[0][1].evaluator))

    def start_one(self, separation: PhaseSeparation, executor: Executor[JobTask, JobResult]) -> bool:
        """Claim a job and submit it to the executor; return False if there is none, or none that may run now."""
        now = self._clock()
        with self._store.read() as session:
            if not cross_play.is_any_waiting(session, now):
                return False
        with self._store.write() as session:
            job = cross_play.claim(session, self._owner, self._settings.work.lease_s * SECOND_US, now)
            if job is None:
                return False
            task = self._load_task(session, job)
            key = f"{CROSS_PLAY_PREFIX}{job.id}.{job.attempt}"
            if task is None:
                cross_play.cancel(session, job.id, now)
                return True
            if not separation.try_begin(key, task.public, now):
                cross_play.release(session, job.id, self._owner, job.attempt)
                return False
        self._held[key] = _HeldPair(task, now)
        executor.submit(key, task)
        return True

    def prolong(self, executor: Executor[JobTask, JobResult], separation: PhaseSeparation) -> None:
        """Prolong the leases that are due; drop jobs that are another's now. Raises StoreUnavailable."""
        now, work = self._clock(), self._settings.work
        due = {key: held for key, held in self._held.items() if now - held.beat_us >= work.heartbeat_s * SECOND_US}
        if not due:
            return
        with self._store.write() as session:
            for key, held in due.items():
                held.beat_us, job = now, held.task.job
                lease_us = work.lease_s * SECOND_US
                if not cross_play.heartbeat(session, job, self._owner, held.task.attempt, lease_us, now):
                    executor.cancel(key)
                    self._drop(key, separation)

    def finish(self, key: str, outcome: JobResult | WorkerFailure, separation: PhaseSeparation) -> bool:
        """Write the outcome of a job; return whether it is a failure on our side. Raises StoreUnavailable."""
        if key not in self._held:
            separation.end(key)
            return False
        task, now = self._held[key].task, self._clock()
        failure, is_rejected = _describe_failure(outcome), isinstance(outcome, AgentRejection)
        held = task.job, self._owner, task.attempt
        with self._store.write() as session:
            if is_rejected:
                cross_play.reject(session, *held, failure, now)
            elif failure:
                cross_play.record_failure(session, *held, failure, now)
            else:
                cross_play.finish(session, *held, _read_score(outcome), now)
        if failure:
            LOG.error("cross-play job %d, attempt %d: %s", task.job, task.attempt, failure)
        self._drop(key, separation)
        return bool(failure) and not is_rejected

    def release(self, executor: Executor[JobTask, JobResult], separation: PhaseSeparation) -> None:
        """Return all jobs to the queue. Raises StoreUnavailable: then their leases expire."""
        for key in self._held:
            executor.cancel(key)
        held = dict(self._held)
        for key in held:
            self._drop(key, separation)
        with self._store.write() as session:
            for one in held.values():
                cross_play.release(session, one.task.job, self._owner, one.task.attempt)

    def _drop(self, key: str, separation: PhaseSeparation) -> None:
        separation.end(key)
        shutil.rmtree(self._held.pop(key).task.stage, ignore_errors=True)

    def _is_ours(self, phase: PhaseRow, submission: SubmissionRow) -> bool:
        return submission.evaluator == self._suites.evaluator(phase, submission.environment)

    def _load_task(self, session: Session, job: CrossPlayJobRow) -> JobTask | None:
        """Return the task of a job; None if it needs another evaluator."""
        phase = phases.get(session, job.phase)
        tested, others = (submissions.get(session, name) for name in (job.tested, job.others))
        if not all(self._is_ours(phase, one) for one in (tested, others)):
            return None
        return JobTask(
            job=job.id,
            attempt=job.attempt,
            submission=f"{CROSS_PLAY_PREFIX}{job.id}",
            archive_sha256=tested.archive_sha256,
            environment=tested.environment,
            track=ChallengeTrack.NEGOTIATION,
            suite=phase.suite,
            scenario=job.scenario,
            seed=cross_play.SEED,
            public=phase.public,
            hidden=not phase.public,
            data=self._settings.data.absolute(),
            sandbox=self._settings.sandbox,
            limits=self._settings.limits,
            other=OtherArchive(others.archive_sha256, others.environment),
            checksum=self._suites.find_checksum(phase, job.scenario),
        )


def _describe_failure(outcome: JobResult | WorkerFailure) -> str:
    """Return why an outcome is no score; "" if it is one.

    For an agent that asks for what is not allowed neither team is blamed: which of the two it was is not known.
    """
    if isinstance(outcome, WorkerFailure):
        return f"{outcome.kind}: {outcome.reason}"
    if isinstance(outcome, AgentRejection):
        return f"one of the agents was rejected: {outcome.why}"
    return outcome.failure if outcome.verdict is ScenarioVerdict.FAILED_OURS else ""


def _read_score(outcome: JobResult | WorkerFailure) -> CrossPlayScore:
    assert not isinstance(outcome, WorkerFailure | AgentRejection), "checked before"
    by_messages = bool((outcome.usage or {}).get(BY_MESSAGES))
    return compute_score(ScenarioResult.model_validate(outcome.result), by_messages=by_messages)


def compute_score(result: ScenarioResult, *, by_messages: bool = False) -> CrossPlayScore:
    """Return the score of the CAV under test, and whose agents failed: each side by its own CAVs.

    by_messages: whether messages of the agent under test made one of the others fail. Then its score is that of a
    failure of its own, with the same factor, and no success: it must gain nothing by stopping its partners.
    """
    tested = [ego for ego in result.egos if not ego.is_other]
    failed = {
        is_other: next((one.reason for one in result.egos if one.is_other is is_other and one.outcome == FAILED), "")
        for is_other in (False, True)
    }
    factor = AGENT_FAILED_FACTOR if by_messages else 1.0
    return CrossPlayScore(
        ds=compute_mean(factor * ego.ds for ego in tested),
        sr=compute_mean(100.0 * (factor * ego.ds > SUCCESS_DS) for ego in tested),
        tested_failed=failed[False],
        others_failed=failed[True],
        by_messages=by_messages,
    )
