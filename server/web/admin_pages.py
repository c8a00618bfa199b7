"""Pages for admins: queue, machine, teams, tokens, and the matrix of teams and scenarios; others get 404."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel, Field

from mdrive_sumo.agent_process import sandbox
from server.api.csv_format import csv_headers, to_csv
from server.api.dependencies import Now, Services, ServicesDep
from server.api.matrix import read_matrix
from server.api.routes import teams as api
from server.api.schemas.parameters import Id
from server.api.schemas.scenarios import MatrixOut
from server.api.schemas.teams import HideIn, NewTokenIn
from server.enums import ChallengeTrack, TokenScope
from server.errors import check_text
from server.evaluation.thinking_times import FLAG_ACTION
from server.store import audit, phases, teams, tokens
from server.tracks import TRACK_LABELS
from server.web import admin_overview, explanations
from server.web.templating import render_page
from server.web.visitor import AdminVisitor, Visitor

router = APIRouter(prefix="/admin")
LAYERS_S = 30.0
"""Time limit of the examination of the sandbox layers [s]: it opens some boxes."""
Text = Annotated[str, Form(max_length=200)]


class MatrixView(BaseModel):
    """The part of the matrix that a page shows."""

    phase: Annotated[str, Field(max_length=40)] = ""
    """Id of a phase; if it is empty, the one that opened last."""
    track: ChallengeTrack | Literal[""] = ""
    """A track; if it is empty, all but joint."""
    sort: Literal["scenario", "ds", "failed"] = "scenario"
    page: Annotated[int, Field(ge=1, le=10_000)] = 1


ViewDep = Annotated[MatrixView, Query()]


@router.get("")
def show(request: Request, _visitor: AdminVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Show queue, workers, spot checks and the audit log."""
    with services.store.read() as session:
        return render_page(
            request,
            "admin.html",
            at_us=at_us,
            queue=admin_overview.list_queue(session),
            drivers=admin_overview.list_workers(session, services.settings, at_us),
            work=services.settings.work,
            latest=admin_overview.list_finished(session),
            spots=admin_overview.list_entries(session, "spot-check"),
            thinking=admin_overview.list_entries(session, FLAG_ACTION),
            entries=admin_overview.list_entries(session),
            head=audit.find_head(session),
            explanations=explanations,
        )


@router.get("/machine")
def show_machine(request: Request, _visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Show what takes a moment to measure: sandbox layers, disk usage, the audit log's hash chain."""
    wanted = services.settings.sandbox
    backend, layers = services.check_runner.call(LAYERS_S, sandbox.examine_backend, wanted.backend, wanted.copies)
    return render_page(
        request,
        "admin_machine.html",
        layers=layers,
        required=wanted.required,
        backend=f"{backend} (auto)" if wanted.backend == sandbox.AUTO else backend,
        gaps=sandbox.GAPS[backend],
        elsewhere=bool(services.settings.work.scheduler) or services.settings.work.processes == 0,
        disk=admin_overview.measure_disk(services.settings.data),
        chain=admin_overview.verify_chain(services.store),
    )


@router.get("/teams")
def show_teams(request: Request, _visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Show all teams, and the tokens without a team."""
    with services.store.read() as session:
        held = [(team, tokens.list_tokens(session, team)) for team in teams.list_teams(session)]
        return render_page(
            request,
            "admin_teams.html",
            teams=held,
            others=tokens.list_tokens(session, None),
            scopes=tuple(TokenScope),
        )


@router.post("/teams")
def create_team(
    request: Request, visitor: AdminVisitor, services: ServicesDep, at_us: Now, name: Text = ""
) -> Response:
    """Create a team with its first token, which is shown only once."""
    actor = visitor.caller.actor
    with services.store.write() as session:
        made = teams.create(session, check_text(name, "name of a team", 64), at_us, actor)
        text = tokens.issue(session, made, TokenScope.SUBMIT, at_us, actor)
    return render_page(request, "admin_token.html", token=text, holder=f"team {made.name}")


@router.post("/teams/{team}/hidden")
def hide_team(
    team: Id, visitor: AdminVisitor, services: ServicesDep, at_us: Now, hidden: Annotated[bool, Form()]
) -> Response:
    """Hide a team from the leaderboards, or show it again."""
    api.hide_team(team, HideIn(hidden=hidden), visitor.caller, services, at_us)
    return RedirectResponse("/admin/teams", 303)


@router.post("/tokens")
def issue_token(
    request: Request,
    visitor: AdminVisitor,
    services: ServicesDep,
    at_us: Now,
    scope: Annotated[TokenScope, Form()],
    team: Text = "",
) -> Response:
    """Issue a token, which is shown only once."""
    made = api.issue_token(NewTokenIn(scope=scope, team=team or None), visitor.caller, services, at_us)
    return render_page(
        request, "admin_token.html", token=made.token, holder="the team" if team else f"the scope {scope}"
    )


@router.get("/tokens/{token}/revoke")
def confirm_revoke(request: Request, token: Id, _visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Ask before a token is revoked."""
    with services.store.read() as session:
        asked = tokens.get(session, token)
        team = teams.get(session, asked.team) if asked.team is not None else None
        held = tokens.list_tokens(session, team) if team is not None else []
    return render_page(
        request,
        "confirm_revoke.html",
        token=asked,
        holder=f"team {team.name}" if team is not None else f"the scope {asked.scope}",
        is_last=sum(each.revoked_us is None for each in held) == 1,
        action=f"/admin/tokens/{token}/revoke",
        back="/admin/teams",
    )


@router.post("/tokens/{token}/revoke")
def revoke_token(token: Id, visitor: AdminVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Revoke a token."""
    api.revoke_token(token, visitor.caller, services, at_us)
    return RedirectResponse("/admin/teams", 303)


@router.get("/matrix")
async def show_matrix(request: Request, view: ViewDep, visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Show DS of teams in each scenario of a phase."""
    return await services.run_large_read(lambda: _render_matrix(request, view, visitor, services))


@router.get("/matrix.csv")
async def download_matrix(view: ViewDep, visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Return the teams of a page of the matrix as CSV."""
    matrix = await services.run_large_read(lambda: _find_matrix(view, view.phase, visitor, services))
    rows = (
        (row.scenario, row.bucket, row.category, row.ds, row.failed, *(cell.ds if cell else None for cell in row.cells))
        for row in matrix.rows
    )
    header = ("scenario", "bucket", "category", "mean", "failed", *(column.team for column in matrix.columns))
    headers = csv_headers(f"matrix-{matrix.phase}") | {"Cache-Control": "no-store"}
    return Response(to_csv(header, rows), media_type="text/csv", headers=headers)


def _render_matrix(request: Request, view: MatrixView, visitor: Visitor, services: Services) -> Response:
    with services.store.read() as session:
        listed = phases.list_phases(session)
    chosen = view.phase or (listed[-1].id if listed else "")
    matrix = _find_matrix(view, chosen, visitor, services) if chosen else None
    rows = list(matrix.rows) if matrix is not None else []
    if view.sort != "scenario":
        rows.sort(key=lambda row: row.ds if view.sort == "ds" else -row.failed)
    context: dict[str, Any] = {"matrix": matrix, "rows": rows, "phases": listed, "sort": view.sort}
    public = any(each.public for each in listed if each.id == chosen)
    return render_page(request, "admin_matrix.html", public=public, tracks=TRACK_LABELS, **context)


def _find_matrix(view: MatrixView, phase: str, visitor: Visitor, services: Services) -> MatrixOut:
    track = ChallengeTrack(view.track) if view.track else None
    return read_matrix(services.store, visitor.caller, phase, track, view.page)
