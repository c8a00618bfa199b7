"""Logging in and out, and making a team where everybody may."""

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse

from mdrive_sumo.core.errors import InputError
from server.api import registration
from server.api.dependencies import Now, ToolsOf
from server.web.error_page import refusal
from server.web.templating import page
from server.web.visitor import MaybeVisitor, find, log_in, log_out

router = APIRouter()
_WRONG = "token: expected one that is valid, found none: it may be mistyped or revoked"
Field = Annotated[str, Form(max_length=200)]


@router.get("/login")
def show_login(request: Request, using: ToolsOf, _visitor: MaybeVisitor) -> Response:
    """The form."""
    return page(request, "login.html", problem="", registration=using.settings.registration)


@router.post("/login")
def login(request: Request, using: ToolsOf, token: Field = "") -> Response:
    """With a token; the page is then the team's own, or the leaderboards."""
    text = token.strip()
    found = find(using.store, text) if text else None
    if found is None:
        return page(request, "login.html", 401, problem=_WRONG, registration=using.settings.registration)
    response = RedirectResponse(f"/teams/{found.caller.team}" if found.caller.team else "/", 303)
    log_in(request, response, text)
    return response


@router.post("/logout")
def logout() -> Response:
    """The token stays valid; the browser forgets it."""
    response = RedirectResponse("/", 303)
    log_out(response)
    return response


@router.get("/register")
def show_register(request: Request, using: ToolsOf, _visitor: MaybeVisitor) -> Response:
    """The form, or whom to ask."""
    return page(request, "register.html", problem="", name="", registration=using.settings.registration)


@router.post("/register")
def register(request: Request, using: ToolsOf, at_us: Now, name: Field = "") -> Response:
    """A team; its token is shown this once, and the browser logged in."""
    settings = using.settings.registration
    try:
        made = registration.register(using.store, settings, name, at_us)
    except InputError as error:
        status, problem, headers = refusal(error, at_us)
        return page(request, "register.html", status, headers, problem=problem, name=name, registration=settings)
    request.state.visitor = find(using.store, made.token)
    response = page(request, "registered.html", token=made.token)
    log_in(request, response, made.token)
    return response
