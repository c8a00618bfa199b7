"""Pages for admins; for everybody else there are none."""

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from mdrive_sumo.agent_process import sandbox
from server.api import schemas
from server.api.dependencies import Now, ServicesDep
from server.api.routes import teams as api
from server.enums import TokenScope
from server.store import audit, teams, tokens
from server.store.errors import check_text
from server.web import admin_overview, explanations
from server.web.templating import render_page
from server.web.visitor import AdminVisitor

router = APIRouter(prefix="/admin")
LOOK_S = 30.0
Text = Annotated[str, Form(max_length=200)]


@router.get("")
def show(request: Request, _visitor: AdminVisitor, services: ServicesDep, at_us: Now) -> Response:
    """How the challenge is doing."""
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
            entries=admin_overview.list_entries(session),
            head=audit.find_head(session),
            words=explanations,
        )


@router.get("/machine")
def show_machine(request: Request, _visitor: AdminVisitor, services: ServicesDep) -> Response:
    """What takes a moment to find out: layers of the sandbox, the disk, the whole chain of the audit log."""
    wanted = services.settings.sandbox
    return render_page(
        request,
        "admin_machine.html",
        layers=services.check_runner.call(LOOK_S, sandbox.examine_layers, wanted.backend),
        required=wanted.required,
        backend=wanted.backend,
        gaps=sandbox.GAPS.get(wanted.backend, ()),
        elsewhere=bool(services.settings.work.scheduler) or services.settings.work.processes == 0,
        disk=admin_overview.measure_disk(services.settings.data),
        chain=admin_overview.verify_chain(services.store),
    )


@router.get("/teams")
def show_teams(request: Request, _visitor: AdminVisitor, services: ServicesDep) -> Response:
    """All teams, and the tokens of nobody's."""
    with services.store.read() as session:
        found = [(team, tokens.list_tokens(session, team)) for team in teams.list_teams(session)]
        return render_page(
            request, "admin_teams.html", teams=found, others=tokens.list_tokens(session, None), scopes=tuple(TokenScope)
        )


@router.post("/teams")
def create_team(
    request: Request, visitor: AdminVisitor, services: ServicesDep, at_us: Now, name: Text = ""
) -> Response:
    """A team with its first token, which is shown this once."""
    who = visitor.caller.actor
    with services.store.write() as session:
        made = teams.create(session, check_text(name, "name of a team", 64), at_us, who)
        text = tokens.issue(session, made, TokenScope.SUBMIT, at_us, who)
    return render_page(request, "admin_token.html", token=text, holder=f"team {made.name}")


@router.post("/teams/{team}/hidden")
def hide_team(
    team: schemas.Id, visitor: AdminVisitor, services: ServicesDep, at_us: Now, hidden: Annotated[bool, Form()]
) -> Response:
    """Off the leaderboards, or back."""
    api.hide_team(team, schemas.HideIn(hidden=hidden), visitor.caller, services, at_us)
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
    """A new token, shown this once."""
    made = api.issue_token(schemas.NewTokenIn(scope=scope, team=team or None), visitor.caller, services, at_us)
    return render_page(
        request, "admin_token.html", token=made.token, holder="the team" if team else f"the scope {scope}"
    )


@router.post("/tokens/{token}/revoke")
def revoke_token(token: schemas.Id, visitor: AdminVisitor, services: ServicesDep, at_us: Now) -> Response:
    """From now on nobody holds it."""
    api.revoke_token(token, visitor.caller, services, at_us)
    return RedirectResponse("/admin/teams", 303)
