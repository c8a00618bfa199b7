"""A submission's life: accepted, driven, and done, rejected, cancelled, disqualified or failed by our fault.

queued -> running -> done -> disqualified
  any of the first two -> rejected | cancelled | failed-ours
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.enums import JobState, State, Track
from server.store import audit, events, phases, quota, standings
from server.store.errors import NotFound, NotNow, checked_text, new_id
from server.store.tables import Job, Phase, Submission, Team

UNFINISHED_JOBS = (JobState.QUEUED.value, JobState.RUNNING.value)
Summarise = Callable[[Sequence[Job]], standings.Summary]
"""From the finished jobs, ordered by scenario and seed."""


@dataclass(frozen=True, slots=True)
class NewSubmission:
    """What a team sends."""

    team: str
    """Its id."""
    track: Track
    name: str
    archive_sha256: str
    archive_bytes: int
    environment: str
    evaluator: dict[str, Any]
    """What will evaluate it: see `Submission.evaluator`."""
    idempotency_key: str | None = None


def accept(
    session: Session, new: NewSubmission, phase: Phase, jobs: Sequence[tuple[str, int]], now_us: int
) -> Submission:
    """A new submission with its jobs (scenario, seed), or the one `known` already.

    Raises NotNow outside the phase, OverLimit, and InputError for unusable text or a reused idempotency key.
    """
    if (old := known(session, new, phase)) is not None:
        return old
    phases.check_open(phase, now_us)
    quota.check(session, new.team, phase, now_us)
    submission = Submission(
        id=new_id(),
        **asdict(new) | {"track": new.track.value, "name": checked_text(new.name, "name of the method", 80)},
        phase=phase.id,
        state=State.QUEUED.value,
        created_us=now_us,
    )
    _insert(session, submission, jobs)
    audit.add(session, f"team:{new.team}", "submission-accepted", _audited(submission), now_us)
    return submission


def known(session: Session, new: NewSubmission, phase: Phase) -> Submission | None:
    """The submission of the same idempotency key, else the finished one of the same archive; None if it is new.

    The same archive under the same evaluator would get the same result: the answer is there at once, and no quota used.
    """
    if new.idempotency_key is not None:
        key = checked_text(new.idempotency_key, "idempotency key", 80)
        old = session.scalar(select(Submission).where(Submission.team == new.team, Submission.idempotency_key == key))
        if old is not None:
            if (old.archive_sha256, old.phase, old.track) != (new.archive_sha256, phase.id, new.track):
                raise InputError(f"idempotency key: expected the same archive, phase and track as before for {key!r}")
            return old
    same = select(Submission).where(
        Submission.team == new.team,
        Submission.phase == phase.id,
        Submission.track == new.track,
        Submission.archive_sha256 == new.archive_sha256,
        Submission.state.in_((State.DONE.value, State.DISQUALIFIED.value)),
    )
    candidates = session.scalars(same.order_by(Submission.created_us.desc()))
    return next((old for old in candidates if old.evaluator == new.evaluator), None)


def environment_of(session: Session, team: str, archive_sha256: str) -> str:
    """Which one an archive asks for that a team has sent before; "" for a new archive."""
    sent = select(Submission.environment).where(Submission.team == team, Submission.archive_sha256 == archive_sha256)
    return session.scalar(sent.limit(1)) or ""


def rerun(
    session: Session,
    submission_id: str,
    evaluator: dict[str, Any],
    jobs: Sequence[tuple[str, int]],
    now_us: int,
    actor: str = "admin",
) -> Submission:
    """The same archive once more, for an admin: both results are kept, the new one counts nowhere until `show`.

    `jobs` are those of the suite as it is now: the one that `evaluator` names, and not the one that it had then.
    """
    old = get(session, submission_id)
    copied = ("team", "phase", "track", "name", "archive_sha256", "archive_bytes", "environment")
    submission = Submission(
        id=new_id(),
        **{name: getattr(old, name) for name in copied},
        evaluator=evaluator,
        state=State.QUEUED.value,
        created_us=now_us,
        counts=False,
        shown=False,
    )
    _insert(session, submission, jobs)
    audit.add(session, actor, "submission-rerun", _audited(submission) | {"of": old.id}, now_us)
    return submission


def renew(
    session: Session,
    submission: Submission,
    evaluator: dict[str, Any],
    jobs: Sequence[tuple[str, int]],
    now_us: int,
) -> None:
    """An unfinished one begins anew under another evaluator, with the jobs that its suite has now."""
    old = Job.submission == submission.id
    begun = session.scalar(select(func.max(Job.attempt)).where(old)) or 0
    session.execute(delete(Job).where(old))
    submission.evaluator, submission.state = evaluator, State.QUEUED.value
    # Ids of deleted rows come again in SQLite; attempts go on, so that no late result of the older version fits.
    _queue(session, submission, jobs, now_us, attempt=begun)
    audit.add(session, "server", "submission-renewed", _audited(submission), now_us)


def get(session: Session, submission_id: str) -> Submission:
    """Raises NotFound."""
    submission = session.get(Submission, submission_id)
    if submission is None:
        raise NotFound(f"submission: there is no {submission_id!r}")
    return submission


def finish_if_complete(session: Session, submission_id: str, summarise: Summarise, now_us: int) -> bool:
    """Done, if every job is; True for the one call that made it so."""
    submission = get(session, submission_id)
    if submission.state not in quota.UNFINISHED or not _complete(session, submission_id):
        return False
    jobs = select(Job).where(Job.submission == submission_id).order_by(Job.scenario, Job.seed)
    summary = summarise(session.scalars(jobs).all())
    submission.summary = dict(summary)
    submission.ds = standings.ds_of(summary["overall"])
    _enter(session, submission, State.DONE, now_us)
    standings.rank(session, submission)
    audit.add(session, "server", "submission-done", _audited(submission) | {"ds": submission.ds}, now_us)
    return True


def cancel(session: Session, submission_id: str, now_us: int, actor: str = "server") -> None:
    """It does not count if nothing of it was ever started. Raises NotNow where it is finished."""
    submission = _unfinished(session, submission_id, "cancelled")
    started = select(func.count()).where(Job.submission == submission_id, Job.attempt > 0)
    submission.counts = submission.counts and bool(session.scalar(started))
    _stop(session, submission, State.CANCELLED, "", now_us, actor)


def reject(session: Session, submission_id: str, why: str, now_us: int) -> None:
    """The agent asks for what it may not have. `why`: one sentence for the team. Raises NotNow if it is finished."""
    _stop(session, _unfinished(session, submission_id, "rejected"), State.REJECTED, why, now_us)


def fail(session: Session, submission_id: str, why: str, now_us: int) -> None:
    """Our fault: it costs the team nothing. `why` reaches the team. Nothing happens if it is finished."""
    submission = get(session, submission_id)
    if submission.state in quota.UNFINISHED:
        submission.counts = False
        _stop(session, submission, State.FAILED_OURS, why, now_us)


def disqualify(session: Session, submission_id: str, why: str, now_us: int, actor: str = "admin") -> None:
    """By an admin, in any state; `why` is shown. It stays known, so that the same archive gets the same answer."""
    submission = get(session, submission_id)
    _stop(session, submission, State.DISQUALIFIED, checked_text(why, "reason", 500), now_us, actor)
    standings.rank(session, submission)


def show(session: Session, submission_id: str, shown: bool, now_us: int, actor: str = "admin") -> None:
    """Whether it may stand on the leaderboard: of those of a team that may, the best does."""
    submission = get(session, submission_id)
    submission.shown = shown
    standings.rank(session, submission)
    audit.add(session, actor, "submission-shown", {"submission": submission.id, "shown": shown}, now_us)


def _insert(session: Session, submission: Submission, jobs: Sequence[tuple[str, int]]) -> None:
    if session.get(Team, submission.team) is None:
        raise NotFound(f"team: there is no {submission.team!r}")
    session.add(submission)
    session.flush()
    _queue(session, submission, jobs, submission.created_us)


def _queue(
    session: Session, submission: Submission, jobs: Sequence[tuple[str, int]], now_us: int, attempt: int = 0
) -> None:
    if not jobs:
        raise ValueError("expected at least one job, found none: it would never finish")
    queued = {"submission": submission.id, "state": JobState.QUEUED.value, "attempt": attempt}
    session.add_all(Job(scenario=scenario, seed=seed, **queued) for scenario, seed in jobs)
    events.add(session, submission.id, "state", {"state": State.QUEUED.value}, now_us)
    session.flush()


def _complete(session: Session, submission_id: str) -> bool:
    undone = select(Job.id).where(Job.submission == submission_id, Job.state != JobState.DONE).limit(1)
    session.flush()
    return session.scalar(undone) is None


def _unfinished(session: Session, submission_id: str, wish: str) -> Submission:
    submission = get(session, submission_id)
    if submission.state not in quota.UNFINISHED:
        raise NotNow(f"submission {submission_id}: it is {submission.state} and can no longer be {wish}")
    return submission


def _stop(session: Session, submission: Submission, state: State, why: str, now_us: int, actor: str = "server") -> None:
    open_jobs = update(Job).where(Job.submission == submission.id, Job.state.in_(UNFINISHED_JOBS))
    session.execute(open_jobs.values(state=JobState.CANCELLED.value, finished_us=now_us, lease_us=None))
    submission.why = why
    _enter(session, submission, state, now_us)
    audit.add(session, actor, f"submission-{state}", _audited(submission) | {"why": why}, now_us)


def _enter(session: Session, submission: Submission, state: State, now_us: int) -> None:
    submission.state = state.value
    submission.finished_us = now_us
    said = {"state": state.value} | ({"why": submission.why} if submission.why else {})
    events.add(session, submission.id, "state", said, now_us)


def _audited(submission: Submission) -> dict[str, Any]:
    return {
        "submission": submission.id,
        "phase": submission.phase,
        "archive_sha256": submission.archive_sha256,
        "evaluator": submission.evaluator,
    }
