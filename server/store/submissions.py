"""Life cycle of submissions: accepted, run, and done, rejected, cancelled, disqualified or failed on our side.

queued -> running -> done -> disqualified
  any of the first two -> rejected | cancelled | failed-ours | over-budget
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import delete, exists, func, select, update
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.enums import ChallengeTrack, JobState, SubmissionState
from server.errors import NotFound, NotNow, check_text, new_id
from server.store import audit, phases, quota, standings, webhooks, worker_time
from server.store.audit import compute_checksum, compute_jobs_checksum
from server.store.tables import EventRow, JobOverviewRow, JobRow, PhaseRow, SubmissionRow, TeamRow

UNFINISHED_JOBS = (JobState.QUEUED.value, JobState.RUNNING.value)
MIN_BUDGET_US = 3_600_000_000
"""Worker time that every submission has, however few its jobs are [us]."""


@dataclass(frozen=True, slots=True)
class NewSubmission:
    """A submission as a team sends it."""

    team: str
    """Id of the team."""
    track: ChallengeTrack
    name: str
    archive_sha256: str
    archive_bytes: int
    environment: str
    evaluator: dict[str, Any]
    """Description of the evaluator as in `SubmissionRow.evaluator`."""
    idempotency_key: str | None = None


def accept(
    session: Session, new: NewSubmission, phase: PhaseRow, jobs: Sequence[tuple[str, int]], now_us: int
) -> SubmissionRow:
    """Insert a submission with its jobs (scenario, seed), or return the one that `find_known` returns.

    Raises NotNow outside the phase, OverLimit, and InputError for unusable text or a reused idempotency key.
    """
    if (old := find_known(session, new, phase)) is not None:
        return old
    phases.check_open(phase, now_us)
    quota.check_quota(session, new.team, phase, now_us)
    submission = SubmissionRow(
        id=new_id(),
        **asdict(new) | {"track": new.track.value, "name": check_text(new.name, "name of the method", 80)},
        phase=phase.id,
        state=SubmissionState.QUEUED.value,
        created_us=now_us,
    )
    _insert_with_jobs(session, submission, jobs)
    audit.add_entry(session, f"team:{new.team}", "submission-accepted", _audit_data(submission, jobs), now_us)
    return submission


def find_known(session: Session, new: NewSubmission, phase: PhaseRow) -> SubmissionRow | None:
    """Return the submission of the same idempotency key, else the finished one of the same archive, else None.

    The same archive under the same evaluator would get the same result, so it is returned at once and uses no quota.
    """
    if new.idempotency_key is not None:
        key = check_text(new.idempotency_key, "idempotency key", 80)
        old = session.scalar(
            select(SubmissionRow).where(SubmissionRow.team == new.team, SubmissionRow.idempotency_key == key)
        )
        if old is not None:
            if (old.archive_sha256, old.phase, old.track) != (new.archive_sha256, phase.id, new.track):
                raise InputError(f"idempotency key: expected the same archive, phase and track as before for {key!r}")
            return old
    same = select(SubmissionRow).where(
        SubmissionRow.team == new.team,
        SubmissionRow.phase == phase.id,
        SubmissionRow.track == new.track,
        SubmissionRow.archive_sha256 == new.archive_sha256,
        SubmissionRow.state.in_((SubmissionState.DONE.value, SubmissionState.DISQUALIFIED.value)),
    )
    candidates = session.scalars(same.order_by(SubmissionRow.created_us.desc()))
    return next((old for old in candidates if old.evaluator == new.evaluator), None)


def find_environment(session: Session, team: str, archive_sha256: str) -> str:
    """Return the environment of an archive that the team has sent before; "" for a new archive."""
    sent = select(SubmissionRow.environment).where(
        SubmissionRow.team == team, SubmissionRow.archive_sha256 == archive_sha256
    )
    return session.scalar(sent.limit(1)) or ""


def rerun(
    session: Session,
    submission_id: str,
    evaluator: dict[str, Any],
    jobs: Sequence[tuple[str, int]],
    now_us: int,
    actor: str = "admin",
) -> SubmissionRow:
    """Submit the archive of a submission again, for an admin; the new one counts nowhere until `set_shown`.

    `jobs` are those of the present suite, which `evaluator` names.
    """
    old = get(session, submission_id)
    copied = ("team", "phase", "track", "name", "archive_sha256", "archive_bytes", "environment")
    submission = SubmissionRow(
        id=new_id(),
        **{name: getattr(old, name) for name in copied},
        evaluator=evaluator,
        state=SubmissionState.QUEUED.value,
        created_us=now_us,
        counts=False,
        shown=False,
    )
    _insert_with_jobs(session, submission, jobs)
    audit.add_entry(session, actor, "submission-rerun", _audit_data(submission, jobs) | {"of": old.id}, now_us)
    return submission


def renew(
    session: Session,
    submission: SubmissionRow,
    evaluator: dict[str, Any],
    jobs: Sequence[tuple[str, int]],
    now_us: int,
) -> None:
    """Restart an unfinished submission under another evaluator, with the present jobs of its suite."""
    old = JobRow.is_of(submission.id)
    begun = session.scalar(select(func.max(JobRow.attempt)).where(old)) or 0
    session.execute(delete(JobOverviewRow).where(JobOverviewRow.submission == submission.id))
    session.execute(delete(JobRow).where(old))
    submission.spent_us = 0
    submission.evaluator, submission.state = evaluator, SubmissionState.QUEUED.value
    # SQLite reuses ids of deleted rows; attempts continue, so that no late result of the older version fits.
    _queue_jobs(session, submission, jobs, now_us, attempt=begun)
    audit.add_entry(session, "server", "submission-renewed", _audit_data(submission, jobs), now_us)


def get(session: Session, submission_id: str) -> SubmissionRow:
    """Return a submission. Raises NotFound."""
    if (submission := session.get(SubmissionRow, submission_id)) is None:
        raise NotFound(f"submission: there is no {submission_id!r}")
    return submission


def is_complete(session: Session, submission_id: str) -> bool:
    """Return whether an unfinished submission only waits for its summary."""
    session.flush()
    undone = select(JobRow.id).where(JobRow.is_of(submission_id), JobRow.state != JobState.DONE).limit(1)
    return get(session, submission_id).state in quota.UNFINISHED and session.scalar(undone) is None


def list_complete(session: Session) -> Sequence[str]:
    """Return the unfinished submissions that only wait for their summary: a worker may die before it writes one."""
    undone = exists().where(JobRow.is_of(SubmissionRow.id), JobRow.state != JobState.DONE)
    complete = select(SubmissionRow.id).where(SubmissionRow.state == SubmissionState.RUNNING, ~undone)
    return session.scalars(complete.order_by(SubmissionRow.created_us)).all()


def list_finished_jobs(session: Session, submission_id: str) -> Sequence[JobRow]:
    """Return the jobs of a complete submission for its summary, by scenario and seed."""
    return session.scalars(
        select(JobRow).where(JobRow.is_of(submission_id)).order_by(JobRow.scenario, JobRow.seed)
    ).all()


def finish_if_complete(session: Session, submission_id: str, summary: standings.SummaryData, now_us: int) -> bool:
    """Mark the submission done if every job is, with the summary of its jobs; return True for the call that does so."""
    if not is_complete(session, submission_id):
        return False
    submission = get(session, submission_id)
    submission.summary = dict(summary)
    submission.ds = standings.round_ds(summary["overall"])
    _enter(session, submission, SubmissionState.DONE, now_us)
    standings.update_standings(session, submission)
    scores = {"ds": submission.ds, "summary_sha256": compute_checksum(submission.summary)}
    audit.add_entry(session, "server", "submission-done", _audit_data(submission) | scores, now_us)
    return True


def end_if_over_budget(session: Session, submission_id: str, job_budget_us: int, now_us: int) -> bool:
    """End an unfinished submission whose jobs used more worker time than it has; return True for the call that does.

    It has `job_budget_us` for each job, in sum, but at least `MIN_BUDGET_US`. It counts against the quota.
    """
    submission = get(session, submission_id)
    if submission.state not in quota.UNFINISHED:
        return False
    jobs = session.scalar(select(func.count()).where(JobRow.is_of(submission_id))) or 0
    budget_us = max(MIN_BUDGET_US, jobs * job_budget_us)
    if worker_time.spent_us(session, submission, now_us) <= budget_us:
        return False
    why = (
        f"its {jobs} scenarios and seeds need more than the {budget_us / 3.6e9:.3g} hours of worker time that it "
        f"has (on average {budget_us / jobs / 1e6:g} s for each): make the agent faster and submit it again"
    )
    _stop(session, submission, SubmissionState.OVER_BUDGET, why, now_us)
    return True


def cancel(session: Session, submission_id: str, now_us: int, actor: str = "server") -> None:
    """Cancel a submission; it does not count if no job was started. Raises NotNow if it is finished."""
    submission = _get_unfinished(session, submission_id, "cancelled")
    started = select(func.count()).where(JobRow.is_of(submission_id), JobRow.attempt > 0)
    submission.counts = submission.counts and bool(session.scalar(started))
    _stop(session, submission, SubmissionState.CANCELLED, "", now_us, actor)


def reject(session: Session, submission_id: str, why: str, now_us: int) -> None:
    """Reject a submission; `why` is one sentence for the team. Raises NotNow if it is finished."""
    quota.count_rejected(session, submission := _get_unfinished(session, submission_id, "rejected"), now_us)
    _stop(session, submission, SubmissionState.REJECTED, why, now_us)


def fail(session: Session, submission_id: str, why: str, now_us: int) -> None:
    """Record a failure on our side, which does not count; the team sees `why`. Does nothing if it is finished."""
    submission = get(session, submission_id)
    if submission.state in quota.UNFINISHED:
        submission.counts = False
        _stop(session, submission, SubmissionState.FAILED_OURS, why, now_us)


def disqualify(session: Session, submission_id: str, why: str, now_us: int, actor: str = "admin") -> None:
    """Disqualify a submission in any state; `why` is shown. It stays known for the same archive."""
    submission = get(session, submission_id)
    _stop(session, submission, SubmissionState.DISQUALIFIED, check_text(why, "reason", 500), now_us, actor)
    standings.update_standings(session, submission)


def set_shown(session: Session, submission_id: str, shown: bool, now_us: int, actor: str = "admin") -> None:
    """Choose whether it may be on the leaderboard, which shows the best such submission of a team."""
    submission = get(session, submission_id)
    submission.shown = shown
    standings.update_standings(session, submission)
    audit.add_entry(session, actor, "submission-shown", {"submission": submission.id, "shown": shown}, now_us)


def _insert_with_jobs(session: Session, submission: SubmissionRow, jobs: Sequence[tuple[str, int]]) -> None:
    if session.get(TeamRow, submission.team) is None:
        raise NotFound(f"team: there is no {submission.team!r}")
    session.add(submission)
    session.flush()
    _queue_jobs(session, submission, jobs, submission.created_us)


def _queue_jobs(
    session: Session, submission: SubmissionRow, jobs: Sequence[tuple[str, int]], now_us: int, attempt: int = 0
) -> None:
    if not jobs:
        raise ValueError("expected at least one job, found none: it would never finish")
    own = {"submission": submission.id, "others": submission.id}
    queued = {"state": JobState.QUEUED.value, "attempt": attempt}
    session.add_all(JobRow(scenario=scenario, seed=seed, **own, **queued) for scenario, seed in jobs)
    add_event(session, submission.id, "state", {"state": SubmissionState.QUEUED.value}, now_us)
    session.flush()


def _get_unfinished(session: Session, submission_id: str, change: str) -> SubmissionRow:
    submission = get(session, submission_id)
    if submission.state not in quota.UNFINISHED:
        raise NotNow(f"submission {submission_id}: it is {submission.state} and can no longer be {change}")
    return submission


def _stop(
    session: Session, submission: SubmissionRow, state: SubmissionState, why: str, now_us: int, actor: str = "server"
) -> None:
    worker_time.charge_running(session, submission, now_us)
    open_jobs = update(JobRow).where(JobRow.is_of(submission.id), JobRow.state.in_(UNFINISHED_JOBS))
    session.execute(open_jobs.values(state=JobState.CANCELLED.value, finished_us=now_us, lease_us=None))
    submission.why = why
    _enter(session, submission, state, now_us)
    audit.add_entry(session, actor, f"submission-{state}", _audit_data(submission) | {"why": why}, now_us)


def _enter(session: Session, submission: SubmissionRow, state: SubmissionState, now_us: int) -> None:
    submission.state, submission.finished_us = state.value, now_us
    webhooks.enqueue(session, submission, now_us)
    data = {"state": state.value} | ({"why": submission.why} if submission.why else {})
    add_event(session, submission.id, "state", data, now_us)


def _audit_data(submission: SubmissionRow, jobs: Sequence[tuple[str, int]] = ()) -> dict[str, Any]:
    names = ("phase", "track", "name", "archive_sha256", "environment", "evaluator", "counts")
    entry = {"submission": submission.id, **{name: getattr(submission, name) for name in names}}
    return entry | ({"jobs_sha256": compute_jobs_checksum(jobs)} if jobs else {})


def add_event(session: Session, submission: str, kind: str, data: dict[str, Any], now_us: int) -> None:
    """Add an event. The team sees it: neither its data nor its time may disclose a hidden scenario."""
    session.add(EventRow(submission=submission, at_us=now_us, kind=kind, data=data))


def list_events(session: Session, submission: str, after_id: int = 0, limit: int = 1000) -> Sequence[EventRow]:
    """Return at most `limit` events after one already seen, the oldest first: a larger id was committed later."""
    after = select(EventRow).where(EventRow.submission == submission, EventRow.id > after_id)
    return session.scalars(after.order_by(EventRow.id).limit(limit)).all()
