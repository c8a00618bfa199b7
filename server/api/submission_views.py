"""Submissions as each caller may see them. Only this module decides what is disclosed of hidden scenarios."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, and_, or_, select, true
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from server.api.problems import hide_paths
from server.api.schemas.parameters import to_datetime
from server.api.schemas.submissions import FiguresOut, QueueOut, SubmissionOut, SummaryOut
from server.clock import HOUR_US
from server.enums import ChallengeTrack, SubmissionState, TokenScope
from server.store import NotFound, Store, queries, standings, submissions, tables, teams, tokens
from server.store.quota import UNFINISHED


@dataclass(frozen=True, slots=True)
class Caller:
    """The holder of a valid token."""

    token: str
    """Id of the token."""
    team: str | None
    """Id of the team; None for tokens of admins and workers."""
    scope: TokenScope

    @property
    def is_admin(self) -> bool:
        """Whether the token has the scope admin."""
        return self.scope is TokenScope.ADMIN

    @property
    def actor(self) -> str:
        """Name of the caller in the audit log."""
        return f"{self.scope}:{self.team or self.token}"


class TeamMember(NamedTuple):
    """The holder of a valid token of a team."""

    caller: Caller
    team: str
    """Id of the team."""


def find_caller(store: Store, text: str) -> Caller | None:
    """Return the holder of the token with this text, None if the token is unknown or revoked."""
    with store.read() as session:
        token = tokens.find_token(session, text)
        return Caller(token.id, token.team, TokenScope(token.scope)) if token else None


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


def may_see_scenarios(caller: Caller | None, phase: tables.PhaseRow) -> bool:
    """Return whether the caller may see results of single scenarios of the phase's visible submissions."""
    return phase.public or (caller is not None and caller.is_admin)


def is_visible(caller: Caller | None) -> ColumnElement[bool]:
    """Return the condition on `SubmissionRow` under which `find_visible` returns a submission to the caller."""
    if caller is not None and caller.is_admin:
        return true()
    shown_teams = select(tables.TeamRow.id).where(~tables.TeamRow.hidden)
    published = and_(
        tables.SubmissionRow.state == SubmissionState.DONE.value,
        tables.SubmissionRow.shown,
        tables.SubmissionRow.team.in_(shown_teams),
    )
    own = caller.team if caller is not None else None
    return published if own is None else or_(published, tables.SubmissionRow.team == own)


def get_phase(session: Session, submission: tables.SubmissionRow) -> tables.PhaseRow:
    """Return the phase of a submission; a foreign key guarantees that it exists."""
    phase = session.get(tables.PhaseRow, submission.phase)
    assert phase is not None
    return phase


def to_submission(session: Session, caller: Caller | None, submission: tables.SubmissionRow) -> SubmissionOut:
    """Return the submission with the fields that the caller may see."""
    phase = get_phase(session, submission)
    finished = submission.finished_us
    track = submission.summary["sensing_track"] if submission.summary is not None else ""
    more = _private_fields(session, phase, submission) if may_see_all(caller, submission) else {}
    exact = phase.public or (caller is not None and caller.is_admin)
    return SubmissionOut(
        id=submission.id,
        team=teams.get(session, submission.team).name,
        phase=submission.phase,
        track=ChallengeTrack(submission.track),
        name=submission.name,
        state=SubmissionState(submission.state),
        why=visible_reason(phase, SubmissionState(submission.state), submission.why),
        created=to_datetime(submission.created_us),
        finished=to_datetime(finished if exact else finished - finished % HOUR_US) if finished is not None else None,
        sensing_track=SensingTrack(track) if track else None,
        counts=submission.counts,
        shown=submission.shown,
        summary=visible_summary(phase, submission.summary, exact),
        **more,
    )


def visible_reason(phase: tables.PhaseRow, state: SubmissionState, said: str) -> str:
    """Return the reason of a state as it may be disclosed."""
    return _REJECTED if said and state is SubmissionState.REJECTED and not phase.public else hide_paths(said)


def visible_summary(phase: tables.PhaseRow, stored: Mapping[str, Any] | None, exact: bool = False) -> SummaryOut | None:
    """Return the figures that may be disclosed: of hidden phases the rounded scores of the whole suite.

    exact: for admins, who may see everything.
    """
    if stored is None:
        return None
    if not (phase.public or exact):
        return SummaryOut(overall=visible_figures(phase, stored["overall"]), buckets={}, categories={})
    return SummaryOut.model_validate({name: stored[name] for name in ("overall", "buckets", "categories")})


def visible_figures(phase: tables.PhaseRow, figures: Mapping[str, Any]) -> FiguresOut:
    """Return the overall figures that may be disclosed: of hidden phases DS to 0.1 and SR to 1 %, and no other.

    An agent knows the hidden scenario that it drives and can choose its score, so each figure carries what it has read
    to its team. docs/api.md derives how many bits are left.
    """
    whole = FiguresOut.model_validate(figures)
    if phase.public:
        return whole
    sr = round(whole.sr) if whole.sr is not None else None
    return FiguresOut(ds=visible_ds(phase, whole.ds), sr=sr, scenarios=whole.scenarios)


def visible_ds(phase: tables.PhaseRow, ds: float) -> float:
    """Return an overall DS as it may be disclosed."""
    return ds if phase.public else standings.round_score(ds, phase.public)


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


def _to_queue(session: Session, phase: tables.PhaseRow, submission: tables.SubmissionRow) -> QueueOut:
    """Omit the estimate while hidden scenarios are queued: it would disclose when each of them ends."""
    before = queries.find_queue_position(session, submission.id)
    eta_s = None
    if phase.public and before.job_us is not None and not _has_hidden_work(session):
        eta_s = -(-before.jobs_ahead * before.job_us // 60_000_000) * 60
    return QueueOut(position=before.position, eta_s=eta_s)


def _has_hidden_work(session: Session) -> bool:
    unfinished = (
        select(tables.SubmissionRow.id)
        .join(tables.PhaseRow, tables.PhaseRow.id == tables.SubmissionRow.phase)
        .where(tables.SubmissionRow.state.in_(UNFINISHED), ~tables.PhaseRow.public)
    )
    return session.scalar(unfinished.limit(1)) is not None
