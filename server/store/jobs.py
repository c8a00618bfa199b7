"""Jobs: claimed under a lease, kept by heartbeats, finished once.

Execution is at least once (workers die, leases end); scoring is exactly once, because a result counts only for the
owner and attempt that hold the job at that moment. The time of cross-play and spot checks is charged to no team: the
organiser asked for them.
"""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, and_, exists, or_, select, update
from sqlalchemy.orm import Session

from mdrive_sumo.core.state import FailureReason
from server.enums import JobKind, JobState, ScenarioVerdict, SubmissionState
from server.errors import NotFound
from server.store import job_selection, submissions, worker_time
from server.store.overviews import make_overview
from server.store.tables import JobOverviewRow, JobRow, PhaseRow, SubmissionRow

MAX_FAILURES = 3
"""Failed attempts on our side after which a job fails, and with it its submission if it is one of its own."""
_FAILURE_FOR_TEAM = "our evaluation failed repeatedly; this submission does not count: submit it again later"


@dataclass(frozen=True, slots=True)
class JobOutcome:
    """Outcome of an attempt. Failures of the agent are results; FAILED_OURS is not."""

    verdict: ScenarioVerdict
    result: dict[str, Any] | None
    """`ScenarioResult` as plain values; None only if the verdict is FAILED_OURS."""
    reason: FailureReason | None = None
    usage: dict[str, Any] | None = None
    failure: str = ""
    """What failed on our side, for admins; "" if nothing did."""

    def __post_init__(self) -> None:
        if (self.result is None) != (self.verdict is ScenarioVerdict.FAILED_OURS):
            raise ValueError(f"expected a result unless it is our failure, found verdict {self.verdict}")


def claim(session: Session, owner: str, lease_us: int, now_us: int, public: bool | None = None) -> JobRow | None:
    """Claim the next job for `owner` (unique to a process) until now + `lease_us`; return None if no job waits.

    `job_selection` says which is next; `public`: only jobs of public phases, or only of hidden ones; None: of all. Jobs
    with expired leases are put back first.
    """
    reclaim_expired(session, now_us)
    next_id = job_selection.select_next(session, now_us, public)
    if next_id is None:
        return None
    claimed = (
        update(JobRow)
        .where(JobRow.id == next_id, JobRow.state == JobState.QUEUED)
        .values(
            state=JobState.RUNNING.value,
            owner=owner,
            attempt=JobRow.attempt + 1,
            lease_us=now_us + lease_us,
            started_us=now_us,
        )
        .returning(JobRow)
    )
    job = session.scalars(claimed, execution_options={"populate_existing": True}).all()[0]
    if job.kind == JobKind.SUBMISSION:
        _mark_running(session, job.submission, now_us)
        _add_event(session, job, "started", {"attempt": job.attempt}, now_us)
    return job


def heartbeat(session: Session, job_id: int, owner: str, attempt: int, lease_us: int, now_us: int) -> bool:
    """Prolong the lease; return False if the job is cancelled or another's: then end its sandboxes and drop it."""
    return _update_held(session, _is_held_by(job_id, owner, attempt), {"lease_us": now_us + lease_us})


def finish(session: Session, job_id: int, owner: str, attempt: int, outcome: JobOutcome, now_us: int) -> bool:
    """Store the result of a submission's scenario; return False if it is dropped.

    It is dropped if the job was cancelled or claimed again in the meantime.
    """
    if outcome.verdict is ScenarioVerdict.FAILED_OURS:
        return record_failure(session, job_id, owner, attempt, outcome.failure, now_us)
    scored = {
        "verdict": outcome.verdict.value,
        "reason": outcome.reason.value if outcome.reason else None,
        "usage": outcome.usage,
    }
    job = end(session, job_id, owner, attempt, outcome.result, now_us, **scored)
    if job is None:
        return False
    assert outcome.result is not None
    overview = make_overview(outcome.result, outcome.usage)
    session.add(JobOverviewRow(job=job.id, submission=job.submission, data=overview))
    _charge(session, job, now_us, is_result=True)
    shown = {"verdict": job.verdict, "reason": job.reason, **_public_scores(outcome.result)}
    _add_event(session, job, "scenario", shown, now_us)
    return True


def end(
    session: Session,
    job_id: int,
    owner: str,
    attempt: int,
    result: dict[str, Any] | None,
    now_us: int,
    **scored: str | dict[str, Any] | None,
) -> JobRow | None:
    """End a job of any kind and return it; None if its result is to be dropped. scored: further columns to set."""
    values = {"state": JobState.DONE.value, "result": result, "finished_us": now_us, "lease_us": None, **scored}
    return get(session, job_id) if _update_held(session, _is_held_by(job_id, owner, attempt), values) else None


def record_failure(session: Session, job_id: int, owner: str, attempt: int, failure: str, now_us: int) -> bool:
    """Record a failure on our side: the job is queued again, or fails with its third. False: it is not held."""
    job = session.scalar(select(JobRow).where(_is_held_by(job_id, owner, attempt)))
    if job is None:
        return False
    _apply_failure(session, job, failure, now_us)
    return True


def give_up(session: Session, job_id: int, owner: str, attempt: int, why: str, now_us: int) -> None:
    """Let a job fail that another attempt would end the same way."""
    job = session.scalar(select(JobRow).where(_is_held_by(job_id, owner, attempt)))
    if job is not None:
        job.failures = MAX_FAILURES - 1
        _apply_failure(session, job, why, now_us)


def release(session: Session, job_id: int, owner: str, attempt: int) -> bool:
    """Put the job back without counting a failure, for a graceful shutdown."""
    values = {"state": JobState.QUEUED.value, "owner": None, "lease_us": None}
    return _update_held(session, _is_held_by(job_id, owner, attempt), values)


def cancel(session: Session, job_id: int, now_us: int) -> None:
    """End a job that is not to be driven any more."""
    values = {"state": JobState.CANCELLED.value, "finished_us": now_us, "owner": None, "lease_us": None}
    session.execute(update(JobRow).where(JobRow.id == job_id).values(**values))


def reclaim_expired(session: Session, now_us: int) -> int:
    """Put back jobs whose lease ended because their worker died or hangs; return how many."""
    ended = session.scalars(select(JobRow).where(JobRow.state == JobState.RUNNING, JobRow.lease_us < now_us)).all()
    for job in ended:
        # The job before this one may just have failed the submission, which cancels all its jobs.
        if job.state == JobState.RUNNING:
            failure = f"lease of {job.owner} ended in attempt {job.attempt}"
            _apply_failure(session, job, failure, now_us)
    return len(ended)


def get(session: Session, job_id: int) -> JobRow:
    """Return a job. Raises NotFound."""
    job = session.get(JobRow, job_id, populate_existing=True)
    if job is None:
        raise NotFound(f"job: there is no {job_id}")
    return job


def is_any_waiting(session: Session, now_us: int) -> bool:
    """Return whether a job is queued or its lease has ended: whether a claim is worth a write transaction."""
    lapsed = and_(JobRow.state == JobState.RUNNING, JobRow.lease_us < now_us)
    first = session.scalar(select(exists().where(or_(job_selection.is_preferred(), lapsed))))
    return bool(first) or job_selection.is_pair_waiting(session)


def _mark_running(session: Session, submission_id: str, now_us: int) -> None:
    submission = submissions.get(session, submission_id)
    if submission.state == SubmissionState.QUEUED:
        submission.state = SubmissionState.RUNNING.value
        submissions.add_event(session, submission_id, "state", {"state": SubmissionState.RUNNING.value}, now_us)


def _charge(session: Session, job: JobRow, now_us: int, is_result: bool) -> None:
    """Charge the time of an attempt to its team: failures on our side too, which an agent might cause on purpose.

    Only results count towards the submission's budget.
    """
    submission = submissions.get(session, job.submission)
    used_us = max(0, now_us - job.started_us) if job.started_us is not None else 0
    worker_time.charge(session, submission, used_us, now_us)
    if is_result:
        submission.spent_us += used_us


def _apply_failure(session: Session, job: JobRow, failure: str, now_us: int) -> None:
    is_of_submission = job.kind == JobKind.SUBMISSION
    if is_of_submission:
        _charge(session, job, now_us, is_result=False)
    job.failures += 1
    job.failure = failure
    job.owner = job.lease_us = None
    if job.failures < MAX_FAILURES:
        job.state = JobState.QUEUED.value
        return
    job.state, job.finished_us = JobState.FAILED.value, now_us
    if is_of_submission:
        job.verdict = ScenarioVerdict.FAILED_OURS.value
        session.flush()
        submissions.fail(session, job.submission, _FAILURE_FOR_TEAM, now_us)


def _is_held_by(job_id: int, owner: str, attempt: int) -> ColumnElement[bool]:
    return and_(JobRow.id == job_id, JobRow.owner == owner, JobRow.attempt == attempt, JobRow.state == JobState.RUNNING)


def _update_held(session: Session, held: ColumnElement[bool], values: dict[str, Any]) -> bool:
    changed = update(JobRow).where(held).values(**values).returning(JobRow.id)
    return len(session.scalars(changed, execution_options={"synchronize_session": False}).all()) == 1


def _add_event(session: Session, job: JobRow, kind: str, data: dict[str, Any], now_us: int) -> None:
    """Add an event unless the phase is hidden: the mere times of events would disclose those of single scenarios."""
    public = (
        select(PhaseRow.public)
        .join(SubmissionRow, SubmissionRow.phase == PhaseRow.id)
        .where(SubmissionRow.id == job.submission)
    )
    if session.scalar(public):
        submissions.add_event(
            session, job.submission, kind, {"scenario": job.scenario, "seed": job.seed, **data}, now_us
        )


def _public_scores(result: dict[str, Any]) -> dict[str, Any]:
    names = ("ds", "sr", "efficient_sr", "time_ratio")
    return {name: result[name] for name in names if result.get(name) is not None}
