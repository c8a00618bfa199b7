"""Submissions as each caller may see them. Only this module decides what is disclosed of hidden scenarios."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.api import schemas
from server.api.caller import Caller
from server.api.hidden_paths import hide_paths
from server.api.schemas import to_datetime
from server.enums import MIN_HIDDEN_SCENARIOS, ChallengeTrack, SubmissionState
from server.store import NotFound, queries, submissions, tables, teams
from server.store.quota import UNFINISHED

_REJECTED = "the agent asks for something that is not offered; in a public phase the sentence says what"
"""Reason shown in hidden phases: the original one contains text of the agent, which may describe the scenario."""


def find_visible(session: Session, caller: Caller | None, submission_id: str) -> tables.SubmissionRow:
    """Return a submission of the caller's team, any for admins, one on a leaderboard for everyone. Raises NotFound.

    The error does not reveal whether the submission exists.
    """
    submission = submissions.get(session, submission_id)
    if may_see_all(caller, submission) or _is_published(session, submission):
        return submission
    raise NotFound(f"submission: there is no {submission_id!r}")


def find_own(session: Session, caller: Caller, submission_id: str) -> tables.SubmissionRow:
    """Return a submission of the caller's team, or any for admins. Raises NotFound."""
    submission = submissions.get(session, submission_id)
    if may_see_all(caller, submission):
        return submission
    raise NotFound(f"submission: there is no {submission_id!r}")


def may_see_all(caller: Caller | None, submission: tables.SubmissionRow) -> bool:
    """Return whether the caller may see everything of a submission: its own team, or an admin."""
    return caller is not None and (caller.is_admin or (caller.team is not None and caller.team == submission.team))


def get_phase(session: Session, submission: tables.SubmissionRow) -> tables.PhaseRow:
    """Return the phase of a submission; a foreign key guarantees that it exists."""
    phase = session.get(tables.PhaseRow, submission.phase)
    assert phase is not None
    return phase


def to_submission(session: Session, caller: Caller | None, submission: tables.SubmissionRow) -> schemas.SubmissionOut:
    """Return the submission with the fields that the caller may see."""
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
    """Return the reason of a state as it may be disclosed."""
    return _REJECTED if said and state is SubmissionState.REJECTED and not phase.public else hide_paths(said)


def visible_summary(phase: tables.PhaseRow, stored: Mapping[str, Any] | None) -> schemas.SummaryOut | None:
    """Return the figures that may be disclosed: in hidden phases only means over enough scenarios."""
    if stored is None:
        return None
    parts = {
        name: {
            part: visible_figures(phase, stored, stored[name][part]) for part in disclosable_parts(phase, stored[name])
        }
        for name in ("buckets", "categories")
    }
    return schemas.SummaryOut(overall=visible_figures(phase, stored, stored["overall"]), **parts)


def visible_figures(
    phase: tables.PhaseRow, stored: Mapping[str, Any] | None, figures: Mapping[str, Any]
) -> schemas.FiguresOut:
    """Return figures of a stored summary without a time ratio that discloses single hidden scenarios.

    It is a mean over fewer scenarios than the others, those in which every CAV arrived, so it is shown if every part of
    the submission has enough of these.
    """
    found = schemas.FiguresOut.model_validate(figures)
    parts = [] if stored is None else [*stored["buckets"].values(), *stored["categories"].values()]
    if phase.public or (parts and all((of.get("timed") or 0) >= MIN_HIDDEN_SCENARIOS for of in parts)):
        return found
    return found.model_copy(update={"time_ratio": None, "timed": None})


def disclosable_parts(phase: tables.PhaseRow, parts: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Return the buckets (or categories) whose figures disclose no single hidden scenario: all or none.

    If one part is too small, showing the others would disclose it by subtraction from the overall figures, or from
    those of the other partition.
    """
    if phase.public or all(of.get("scenarios", 0) >= MIN_HIDDEN_SCENARIOS for of in parts.values()):
        return set(parts)
    return set()


def visible_event(phase: tables.PhaseRow, kind: str, data: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the data of an event that may be disclosed, None for nothing. Hidden phases disclose only states."""
    if phase.public:
        return dict(data) | ({"why": hide_paths(data["why"])} if "why" in data else {})
    if kind != "state":
        return None
    state = SubmissionState(data["state"])
    return {"state": state.value} | ({"why": visible_reason(phase, state, data["why"])} if "why" in data else {})


def _is_published(session: Session, submission: tables.SubmissionRow) -> bool:
    """Return whether it is done, shown by its team, and the team is not hidden."""
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
    """Omit the estimate while hidden scenarios are queued: it would disclose when each of them ends."""
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
