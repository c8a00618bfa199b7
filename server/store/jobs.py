"""Jobs: claimed under a lease, given a heartbeat, finished once.

Execution is at least once (workers die, leases end); scoring is exactly once, because a finish only takes effect for
the owner and attempt that hold the job at that moment.
"""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, exists, func, select, update
from sqlalchemy.orm import Session, aliased

from server.enums import JobState, Reason, State, Verdict
from server.store import events, submissions
from server.store.errors import NotFound
from server.store.quota import UNFINISHED
from server.store.tables import Job, Phase, Submission

MOST_FAILURES = 3
"""Attempts that may end by our fault; with the last the submission fails."""
_TO_THE_TEAM = "our evaluation failed repeatedly; this submission does not count, please send it again later"


@dataclass(frozen=True, slots=True)
class JobOutcome:
    """What a worker hands back. The agent's failures are results; FAILED_OURS is none."""

    verdict: Verdict
    result: dict[str, Any] | None
    """`ScenarioResult` as plain values; None only where the verdict is FAILED_OURS."""
    reason: Reason | None = None
    usage: dict[str, Any] | None = None
    failure: str = ""
    """For admins: what of ours went wrong."""

    def __post_init__(self) -> None:
        if (self.result is None) != (self.verdict is Verdict.FAILED_OURS):
            raise ValueError(f"expected a result unless it is our failure, found verdict {self.verdict}")


def claim(session: Session, owner: str, lease_us: int, now_us: int) -> Job | None:
    """The next job for `owner` (unique to a process), until now + `lease_us`; None if there is nothing to do.

    Order: hidden phases before public ones, then the team with the fewest jobs running, then age. Jobs whose lease
    ended go back first.
    """
    sweep(session, now_us)
    submission_id = session.scalar(_next_submission())
    if submission_id is None:
        return None
    oldest = select(Job.id).where(Job.submission == submission_id, Job.state == JobState.QUEUED)
    claimed = (
        update(Job)
        .where(Job.id == oldest.order_by(Job.id).limit(1).scalar_subquery(), Job.state == JobState.QUEUED)
        .values(
            state=JobState.RUNNING.value,
            owner=owner,
            attempt=Job.attempt + 1,
            lease_us=now_us + lease_us,
            started_us=now_us,
        )
        .returning(Job)
    )
    job = session.scalars(claimed, execution_options={"populate_existing": True}).all()[0]
    _start(session, submission_id, now_us)
    _tell(session, job, "started", {"attempt": job.attempt}, now_us)
    return job


def heartbeat(session: Session, job_id: int, owner: str, attempt: int, lease_us: int, now_us: int) -> bool:
    """Prolongs the lease. False: the job is cancelled or another's; kill the boxes and forget it."""
    return _changed(session, _held(job_id, owner, attempt), {"lease_us": now_us + lease_us})


def finish(session: Session, job_id: int, owner: str, attempt: int, outcome: JobOutcome, now_us: int) -> bool:
    """Keeps the result. False: a late twin, or cancelled in the meantime; the result is dropped."""
    if outcome.verdict is Verdict.FAILED_OURS:
        return give_back(session, job_id, owner, attempt, outcome.failure, now_us)
    values = {
        "state": JobState.DONE.value,
        "verdict": outcome.verdict.value,
        "reason": outcome.reason.value if outcome.reason else None,
        "result": outcome.result,
        "usage": outcome.usage,
        "finished_us": now_us,
        "lease_us": None,
    }
    if not _changed(session, _held(job_id, owner, attempt), values):
        return False
    job = get(session, job_id)
    _tell(session, job, "scenario", {"verdict": job.verdict, "reason": job.reason, **_shown(outcome.result)}, now_us)
    return True


def give_back(session: Session, job_id: int, owner: str, attempt: int, failure: str, now_us: int) -> bool:
    """Our fault, said in `failure`: another attempt, or with the third failure the end of the submission."""
    job = session.scalar(select(Job).where(_held(job_id, owner, attempt)))
    if job is None:
        return False
    _failed(session, job, failure, now_us)
    return True


def release(session: Session, job_id: int, owner: str, attempt: int) -> bool:
    """Back to the queue without blame: for a graceful shutdown."""
    values = {"state": JobState.QUEUED.value, "owner": None, "lease_us": None}
    return _changed(session, _held(job_id, owner, attempt), values)


def sweep(session: Session, now_us: int) -> int:
    """Takes back jobs whose lease ended: their worker died or hangs. How many."""
    ended = session.scalars(select(Job).where(Job.state == JobState.RUNNING, Job.lease_us < now_us)).all()
    for job in ended:
        # The submission may just have failed by the job before this one, and all its jobs been cancelled with it.
        if job.state == JobState.RUNNING:
            _failed(session, job, f"lease of {job.owner} ended in attempt {job.attempt}", now_us)
    return len(ended)


def get(session: Session, job_id: int) -> Job:
    """Raises NotFound."""
    job = session.get(Job, job_id, populate_existing=True)
    if job is None:
        raise NotFound(f"job: there is no {job_id}")
    return job


def _next_submission() -> Select[str]:
    running = aliased(Submission)
    busy = (
        select(running.team, func.count().label("jobs"))
        .join(Job, Job.submission == running.id)
        .where(Job.state == JobState.RUNNING)
        .group_by(running.team)
        .subquery()
    )
    waiting = exists().where(Job.submission == Submission.id, Job.state == JobState.QUEUED)
    return (
        select(Submission.id)
        .join(Phase, Phase.id == Submission.phase)
        .outerjoin(busy, busy.c.team == Submission.team)
        .where(Submission.state.in_(UNFINISHED), waiting)
        .order_by(Phase.public, func.coalesce(busy.c.jobs, 0), Submission.created_us, Submission.id)
        .limit(1)
    )


def _start(session: Session, submission_id: str, now_us: int) -> None:
    submission = submissions.get(session, submission_id)
    if submission.state == State.QUEUED:
        submission.state = State.RUNNING.value
        events.add(session, submission_id, "state", {"state": State.RUNNING.value}, now_us)


def _failed(session: Session, job: Job, failure: str, now_us: int) -> None:
    job.failures += 1
    job.failure = failure
    job.owner = job.lease_us = None
    if job.failures < MOST_FAILURES:
        job.state = JobState.QUEUED.value
        return
    job.state, job.verdict, job.finished_us = JobState.FAILED.value, Verdict.FAILED_OURS.value, now_us
    session.flush()
    submissions.fail(session, job.submission, _TO_THE_TEAM, now_us)


def _held(job_id: int, owner: str, attempt: int) -> ColumnElement[bool]:
    return and_(Job.id == job_id, Job.owner == owner, Job.attempt == attempt, Job.state == JobState.RUNNING)


def _changed(session: Session, held: ColumnElement[bool], values: dict[str, Any]) -> bool:
    changed = update(Job).where(held).values(**values).returning(Job.id)
    return len(session.scalars(changed, execution_options={"synchronize_session": False}).all()) == 1


def _tell(session: Session, job: Job, kind: str, said: dict[str, Any], now_us: int) -> None:
    """Of hidden phases nothing is told: the mere times of events would be timings of single scenarios."""
    public = select(Phase.public).join(Submission, Submission.phase == Phase.id).where(Submission.id == job.submission)
    if session.scalar(public):
        events.add(session, job.submission, kind, {"scenario": job.scenario, "seed": job.seed, **said}, now_us)


def _shown(result: dict[str, Any] | None) -> dict[str, Any]:
    return {name: result[name] for name in ("ds", "sr") if name in result} if result else {}
