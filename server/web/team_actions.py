"""What members do on their team's page besides submitting: tokens and the webhook."""

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.api.dependencies import Now, ServicesDep
from server.api.routes import webhook as api
from server.api.schemas.parameters import Id
from server.api.schemas.teams import NewWebhookIn
from server.enums import TokenScope
from server.store import NotFound, tables, teams, tokens
from server.web.templating import render_page
from server.web.visitor import AnyVisitor, TeamVisitor, Visitor, delete_token_cookie

router = APIRouter(prefix="/teams/{team}")
MAX_TOKENS = 20
"""Valid tokens of a team: one that is stolen cannot make any number of others."""
TokenField = Annotated[Id, Form()]


@router.post("/tokens")
def issue(request: Request, team: Id, visitor: AnyVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Issue another token of the team, which is shown only once."""
    with services.store.write() as session:
        found = _find_own(session, visitor, team)
        if sum(each.revoked_us is None for each in tokens.list_tokens(session, found)) >= MAX_TOKENS:
            raise InputError(f"token: expected fewer than {MAX_TOKENS} valid ones, found as many: revoke one first")
        text = tokens.issue(session, found, TokenScope.SUBMIT, at_us, visitor.caller.actor)
    use = "Programs read it from MDRIVE_TOKEN; a browser logs in with it. Anyone who has it can submit for the team."
    back = f"/teams/{team}#tokens"
    return render_page(
        request, "secret.html", title="A new token", secret=text, holder=f"team {found.name}", use=use, back=back
    )


@router.get("/tokens/{token}/revoke")
def confirm(request: Request, team: Id, token: Id, visitor: AnyVisitor, services: ServicesDep) -> Response:
    """Ask before a token is revoked."""
    with services.store.read() as session:
        found = _find_own(session, visitor, team)
        held = tokens.list_tokens(session, found)
        asked = _find_held(session, found, token)
    return render_page(
        request,
        "confirm_revoke.html",
        token=asked,
        holder=f"team {found.name}",
        is_last=sum(each.revoked_us is None for each in held) == 1,
        action=f"/teams/{team}/revoke",
        back=f"/teams/{team}#tokens",
    )


@router.post("/revoke")
def revoke(team: Id, token: TokenField, visitor: AnyVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Revoke a token of the visitor's team, or any for admins; revoking the browser's own token logs out."""
    with services.store.write() as session:
        _find_held(session, _find_own(session, visitor, team, token), token)
        tokens.revoke(session, token, at_us, visitor.caller.actor)
    if token != visitor.caller.token:
        return RedirectResponse(f"/teams/{team}#tokens", 303)
    response = RedirectResponse("/login", 303)
    delete_token_cookie(response)
    return response


@router.post("/webhook")
def set_webhook(
    request: Request,
    team: Id,
    visitor: TeamVisitor,
    services: ServicesDep,
    at_us: Now,
    url: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Set the webhook of the visitor's team; its secret is shown only once."""
    _require_same(visitor[1], team)
    made = api.set_webhook(NewWebhookIn.model_construct(url=url), visitor, services, at_us)
    use = "Your program verifies the header webhook-signature with it (Standard Webhooks)."
    back = f"/teams/{team}#webhook"
    return render_page(
        request, "secret.html", title="Secret of the webhook", secret=made.secret, holder=made.url, use=use, back=back
    )


@router.post("/webhook/remove")
def remove_webhook(team: Id, visitor: TeamVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Remove the webhook of the visitor's team."""
    _require_same(visitor[1], team)
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
