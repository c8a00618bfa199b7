"""Submissions as each caller may see them. What of hidden scenarios leaves the server is decided here only."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.api import schemas
from server.api.caller import Caller
from server.api.schemas import to_datetime
from server.enums import MIN_HIDDEN_SCENARIOS, ChallengeTrack, SubmissionState
from server.store import NotFound, queries, submissions, tables, teams
from server.store.quota import UNFINISHED

_REJECTED = "the agent asks for something that is not offered; in a public phase the sentence says what"
"""In hidden phases: the sentence itself holds text of the agent, which could be what the agent saw."""


def find_visible(session: Session, caller: Caller | None, submission_id: str) -> tables.SubmissionRow:
    """One that the caller may see: its own, any for admins, those on leaderboards for everybody. Raises NotFound.

    Whether there is one that the caller may not see is not told.
    """
    submission = submissions.get(session, submission_id)
    if may_see_all(caller, submission) or _is_published(session, submission):
        return submission
    raise NotFound(f"submission: there is no {submission_id!r}")


def find_own(session: Session, caller: Caller, submission_id: str) -> tables.SubmissionRow:
    """One of the caller's team, or any for admins. Raises NotFound."""
    submission = submissions.get(session, submission_id)
    if may_see_all(caller, submission):
        return submission
    raise NotFound(f"submission: there is no {submission_id!r}")


def may_see_all(caller: Caller | None, submission: tables.SubmissionRow) -> bool:
    """Whether it is the caller's, who may then see more than everybody."""
    return caller is not None and (caller.is_admin or (caller.team is not None and caller.team == submission.team))


def get_phase(session: Session, submission: tables.SubmissionRow) -> tables.PhaseRow:
    """It is always there: a foreign key says so."""
    phase = session.get(tables.PhaseRow, submission.phase)
    assert phase is not None
    return phase


def to_submission(session: Session, caller: Caller | None, submission: tables.SubmissionRow) -> schemas.SubmissionOut:
    """As the caller may see it."""
    phase = get_phase(session, submission)
    finished = submission.finished_us
    more = _private_fields(session, phase, submission) if may_see_all(caller, submission) else {}
    return schemas.SubmissionOut(
        id=submission.id,
        team=teams.get(session, submission.team).name,
        phase=submission.phase,
        track=ChallengeTrack(submission.track),
        name=submission.name,
        state=SubmissionState(submission.state),
        why=visible_reason(phase, SubmissionState(submission.state), submission.why),
        created=to_datetime(submission.created_us),
        finished=to_datetime(finished) if finished is not None else None,
        counts=submission.counts,
        shown=submission.shown,
        summary=visible_summary(phase, submission.summary),
        **more,
    )


def visible_reason(phase: tables.PhaseRow, state: SubmissionState, said: str) -> str:
    """The sentence that goes with a state."""
    return _REJECTED if said and state is SubmissionState.REJECTED and not phase.public else said


def visible_summary(phase: tables.PhaseRow, stored: Mapping[str, Any] | None) -> schemas.SummaryOut | None:
    """Only known figures; in hidden phases only means over enough scenarios: all of a phase are enough."""
    if stored is None:
        return None
    parts = {
        name: {
            part: schemas.FiguresOut.model_validate(stored[name][part])
            for part in disclosable_parts(phase, stored[name])
        }
        for name in ("buckets", "categories")
    }
    return schemas.SummaryOut(overall=schemas.FiguresOut.model_validate(stored["overall"]), **parts)


def disclosable_parts(phase: tables.PhaseRow, parts: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Of all buckets, or all categories, those whose figures say nothing about single hidden scenarios: all or none.

    With a small part among them, even one that is not shown, the small one would come out by subtraction: from the
    whole, or buckets from the categories within them.
    """
    if phase.public or all(of.get("scenarios", 0) >= MIN_HIDDEN_SCENARIOS for of in parts.values()):
        return set(parts)
    return set()


def visible_event(phase: tables.PhaseRow, kind: str, data: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What an event says; None for one that must not be told. Of hidden phases only states are."""
    if phase.public:
        return data
    if kind != "state":
        return None
    state = SubmissionState(data["state"])
    return {"state": state.value} | ({"why": visible_reason(phase, state, data["why"])} if "why" in data else {})


def _is_published(session: Session, submission: tables.SubmissionRow) -> bool:
    """Done, shown by its team, and of a team that stands on leaderboards."""
    if submission.state != SubmissionState.DONE or not submission.shown:
        return False
    return not teams.get(session, submission.team).hidden


def _private_fields(session: Session, phase: tables.PhaseRow, submission: tables.SubmissionRow) -> dict[str, Any]:
    counts = queries.count_jobs(session, submission.id) if phase.public else None
    queue = _to_queue(session, phase, submission) if submission.state in UNFINISHED else None
    return {
        "archive_sha256": submission.archive_sha256,
        "archive_bytes": submission.archive_bytes,
        "environment": submission.environment,
        "evaluator": submission.evaluator,
        "progress": counts,
        "queue": queue,
    }


def _to_queue(session: Session, phase: tables.PhaseRow, submission: tables.SubmissionRow) -> schemas.QueueOut:
    """No estimate where jobs of hidden scenarios are ahead or of its own: it would tell when each of them ends."""
    before = queries.find_queue_position(session, submission.id)
    eta_s = None
    if phase.public and before.job_us is not None and not _has_hidden_work(session):
        eta_s = -(-before.jobs_ahead * before.job_us // 60_000_000) * 60
    return schemas.QueueOut(position=before.position, eta_s=eta_s)


def _has_hidden_work(session: Session) -> bool:
    unfinished = (
        select(tables.SubmissionRow.id)
        .join(tables.PhaseRow, tables.PhaseRow.id == tables.SubmissionRow.phase)
        .where(tables.SubmissionRow.state.in_(UNFINISHED), ~tables.PhaseRow.public)
    )
    return session.scalar(unfinished.limit(1)) is not None
