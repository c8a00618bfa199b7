"""Log in, log out, and register a team."""

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from mdrive_sumo.core.errors import InputError
from server.api.dependencies import Now, ServicesDep
from server.api.routes.teams import register_team
from server.web.templating import describe_refusal, render_page
from server.web.visitor import OptionalVisitor, delete_token_cookie, find_visitor, set_token_cookie

router = APIRouter()
_INVALID_TOKEN = "token: expected one that is valid, found none: it may be mistyped or revoked"
Field = Annotated[str, Form(max_length=200)]


@router.get("/login")
def show_login(request: Request, services: ServicesDep, _visitor: OptionalVisitor) -> Response:
    """Show the form."""
    return render_page(request, "login.html", problem="", registration=services.settings.registration)


@router.post("/login")
def login(request: Request, services: ServicesDep, token: Field = "") -> Response:
    """Log in with a token; redirect to the team's page or to the leaderboards."""
    text = token.strip()
    visitor = find_visitor(services.store, text) if text else None
    if visitor is None:
        return render_page(
            request, "login.html", 401, problem=_INVALID_TOKEN, registration=services.settings.registration
        )
    response = RedirectResponse(f"/teams/{visitor.caller.team}" if visitor.caller.team else "/", 303)
    set_token_cookie(request, response, text)
    return response


@router.post("/logout")
def logout() -> Response:
    """Delete the cookie; the token stays valid."""
    response = RedirectResponse("/", 303)
    delete_token_cookie(response)
    return response


@router.get("/register")
def show_register(request: Request, services: ServicesDep, _visitor: OptionalVisitor) -> Response:
    """Show the form, or that registration is closed."""
    return render_page(request, "register.html", problem="", name="", registration=services.settings.registration)


@router.post("/register")
def register(request: Request, services: ServicesDep, at_us: Now, name: Field = "") -> Response:
    """Register a team, show its token once, and log in."""
    settings = services.settings.registration
    try:
        made = register_team(services.store, settings, name, at_us)
    except InputError as error:
        status, problem, headers = describe_refusal(error, at_us)
        return render_page(request, "register.html", status, headers, problem=problem, name=name, registration=settings)
    request.state.visitor = find_visitor(services.store, made.token)
    response = render_page(request, "registered.html", token=made.token)
    set_token_cookie(request, response, made.token)
    return response
