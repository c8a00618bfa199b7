"""A team's page: public history; for members also hidden submissions, quota, tokens and the webhook."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import RedirectResponse
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.api import submission_views
from server.api.dependencies import Now, ServicesDep
from server.api.routes import submissions
from server.api.routes import webhook as api
from server.api.schemas.parameters import Id, TeamName
from server.api.schemas.submissions import FiguresOut
from server.api.schemas.teams import NewWebhookIn, ShowIn
from server.api.submission_views import TeamMember
from server.clock import format_utc
from server.enums import SubmissionState, TokenScope
from server.store import NotFound, phases, queries, quota, tables, teams, tokens
from server.tracks import TRACK_LABELS
from server.web import charts, explanations
from server.web.templating import render_page
from server.web.visitor import AnyVisitor, OptionalVisitor, TeamVisitor, Visitor, delete_token_cookie

router = APIRouter()
MAX_TOKENS = 20
"""Valid tokens of a team: one that is stolen cannot make any number of others."""
SubmissionField = Annotated[Id, Form()]
TokenField = Annotated[Id, Form()]


@dataclass(frozen=True, slots=True)
class PhaseHistory:
    """A team's shown results in a phase, the oldest first."""

    phase: tables.PhaseRow
    results: Sequence[tuple[tables.SubmissionRow, FiguresOut]]
    chart: charts.HistoryChart | None


@dataclass(frozen=True, slots=True)
class QuotaLeft:
    """Remaining quota in an open phase."""

    phase: tables.PhaseRow
    today: int
    at_a_time: int
    in_total: int


@router.get("/teams/{team}")
def show(
    request: Request,
    team: TeamName,
    services: ServicesDep,
    at_us: Now,
    visitor: OptionalVisitor,
    before: Annotated[Id | None, Query()] = None,
) -> Response:
    """Show the page of a team (name or id). Only members and admins see a hidden team."""
    with services.store.read() as session:
        shown = teams.get(session, team)
        own = _is_own(visitor, shown)
        if shown.hidden and not own:
            raise NotFound(f"team: there is no {team!r}")
        histories = [
            history
            for phase in phases.list_phases(session)
            if (history := _make_history(session, shown, phase)).results
        ]
        left = _list_quota_left(session, shown, at_us) if own else []
        held = tokens.list_tokens(session, shown) if own else []
    listed = None
    if visitor is not None and own:
        of_team = shown.id if visitor.caller.is_admin else None
        listed = submissions.list_submissions(visitor.caller, services, None, of_team, before)
    is_member = visitor is not None and visitor.caller.team == shown.id
    member = TeamMember(visitor.caller, shown.id) if visitor is not None and is_member else None
    webhook = api.show_webhook(member, services) if member is not None else None
    return render_page(
        request,
        "team.html",
        webhook=webhook,
        team=shown,
        histories=histories,
        own=own,
        left=left,
        tokens=held,
        listed=listed,
        tracks=TRACK_LABELS,
        explanations=explanations,
    )


@router.post("/teams/{team}/shown")
def choose(
    team: Id,
    submission: SubmissionField,
    shown: Annotated[bool, Form()],
    visitor: AnyVisitor,
    services: ServicesDep,
    at_us: Now,
) -> Response:
    """Choose whether a submission may be on the leaderboard."""
    submissions.choose_submission(submission, ShowIn(shown=shown), visitor.caller, services, at_us)
    return RedirectResponse(f"/teams/{team}#submissions", 303)


def _is_own(visitor: Visitor | None, team: tables.TeamRow) -> bool:
    return visitor is not None and (visitor.caller.is_admin or visitor.caller.team == team.id)


def _make_history(session: Session, team: tables.TeamRow, phase: tables.PhaseRow) -> PhaseHistory:
    """Return the finished and shown submissions, as `GET /leaderboards/{phase}/teams/{team}` does."""
    results = [
        (each, summary.overall)
        for each in queries.list_history(session, team.id, phase.id)
        if each.state == SubmissionState.DONE
        and each.shown
        and (summary := submission_views.visible_summary(phase, each.summary)) is not None
    ]
    points = [
        charts.ChartPoint(each.created_us, figures.ds, figures.ds_low, figures.ds_high, each.name, each.track)
        for each, figures in results
    ]
    return PhaseHistory(phase, results, charts.make_history(points, _describe_points(points)) if points else None)


def _describe_points(points: Sequence[charts.ChartPoint]) -> str:
    first, last = points[0], points[-1]
    if len(points) == 1:
        return f"Driving score of one submission: {first.value:.1f}, {format_utc(first.at_us)}"
    return (
        f"Driving score over time, {len(points)} submissions: {first.value:.1f} on {format_utc(first.at_us)[:10]}, "
        f"{last.value:.1f} on {format_utc(last.at_us)[:10]}, best {max(point.value for point in points):.1f}"
    )


def _list_quota_left(session: Session, team: tables.TeamRow, at_us: int) -> list[QuotaLeft]:
    left: list[QuotaLeft] = []
    for phase in phases.list_phases(session):
        if phase.opens_us <= at_us < phase.closes_us:
            used = quota.count_used(session, team.id, phase.id, at_us)
            limits = (phase.per_day - used.today, phase.in_parallel - used.in_parallel, phase.in_total - used.in_total)
            left.append(QuotaLeft(phase, *(max(0, number) for number in limits)))
    return left


@router.post("/teams/{team}/tokens")
def issue_token(request: Request, team: Id, visitor: AnyVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Issue another token of the team, which is shown only once."""
    with services.store.write() as session:
        own = _find_own(session, visitor, team)
        if sum(each.revoked_us is None for each in tokens.list_tokens(session, own)) >= MAX_TOKENS:
            raise InputError(f"token: expected fewer than {MAX_TOKENS} valid ones, found as many: revoke one first")
        text = tokens.issue(session, own, TokenScope.SUBMIT, at_us, visitor.caller.actor)
    use = "Programs read it from MDRIVE_TOKEN; a browser logs in with it. Anyone who has it can submit for the team."
    back = f"/teams/{team}#tokens"
    return render_page(
        request, "secret.html", title="A new token", secret=text, holder=f"team {own.name}", use=use, back=back
    )


@router.get("/teams/{team}/tokens/{token}/revoke")
def confirm_revoke(request: Request, team: Id, token: Id, visitor: AnyVisitor, services: ServicesDep) -> Response:
    """Ask before a token is revoked."""
    with services.store.read() as session:
        own = _find_own(session, visitor, team)
        held = tokens.list_tokens(session, own)
        asked = _find_held(session, own, token)
    return render_page(
        request,
        "confirm_revoke.html",
        token=asked,
        holder=f"team {own.name}",
        is_last=sum(each.revoked_us is None for each in held) == 1,
        action=f"/teams/{team}/revoke",
        back=f"/teams/{team}#tokens",
    )


@router.post("/teams/{team}/revoke")
def revoke_token(team: Id, token: TokenField, visitor: AnyVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Revoke a token of the visitor's team, or any for admins; revoking the browser's own token logs out."""
    with services.store.write() as session:
        _find_held(session, _find_own(session, visitor, team, token), token)
        tokens.revoke(session, token, at_us, visitor.caller.actor)
    if token != visitor.caller.token:
        return RedirectResponse(f"/teams/{team}#tokens", 303)
    response = RedirectResponse("/login", 303)
    delete_token_cookie(response)
    return response


@router.post("/teams/{team}/webhook")
def set_webhook(
    request: Request,
    team: Id,
    visitor: TeamVisitor,
    services: ServicesDep,
    at_us: Now,
    url: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Set the webhook of the visitor's team; its secret is shown only once."""
    _require_same(visitor.team, team)
    made = api.set_webhook(NewWebhookIn.model_construct(url=url), visitor, services, at_us)
    use = "Your program verifies the header webhook-signature with it (Standard Webhooks)."
    back = f"/teams/{team}#webhook"
    return render_page(
        request, "secret.html", title="Secret of the webhook", secret=made.secret, holder=made.url, use=use, back=back
    )


@router.post("/teams/{team}/webhook/remove")
def remove_webhook(team: Id, visitor: TeamVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Remove the webhook of the visitor's team."""
    _require_same(visitor.team, team)
    api.remove_webhook(visitor, services, at_us)
    return RedirectResponse(f"/teams/{team}#webhook", 303)


def _find_own(session: Session, visitor: Visitor, team: str, token: str = "") -> tables.TeamRow:
    """Return the visitor's team, or any for admins. Raises NotFound, which names what was asked for."""
    if visitor.caller.is_admin or visitor.caller.team == team:
        return teams.get(session, team)
    raise NotFound(f"token: there is no {token!r}" if token else f"team: there is no {team!r}")


def _find_held(session: Session, team: tables.TeamRow, token: str) -> tables.TokenRow:
    for each in tokens.list_tokens(session, team):
        if each.id == token:
            return each
    raise NotFound(f"token: there is no {token!r}")


def _require_same(own: str, team: str) -> None:
    if own != team:
        raise NotFound(f"team: there is no {team!r}")
