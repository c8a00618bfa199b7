"""The visitor of a page: the holder of the token in a cookie. The API does not accept the cookie."""

from dataclasses import dataclass
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request, Response
from starlette.concurrency import run_in_threadpool

from server.api.dependencies import ServicesDep
from server.api.problems import ProblemError
from server.api.submission_views import Caller, TeamMember, find_caller
from server.store import NotFound, Store, teams

COOKIE = "mdrive_token"
_KEPT_S = 30 * 86_400
"""Time for which a browser keeps the token [s]: 30 days."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """A visitor who is logged in."""

    caller: Caller
    """The visitor as the API's caller."""
    name: str
    """Name of the team; of the scope for tokens without a team."""


def find_visitor(store: Store, text: str) -> Visitor | None:
    """Return the holder of a token; None if it is unknown or revoked."""
    caller = find_caller(store, text)
    if caller is None or caller.team is None:
        return None if caller is None else Visitor(caller, str(caller.scope))
    with store.read() as session:
        return Visitor(caller, teams.get(session, caller.team).name)


async def get_visitor(request: Request, services: ServicesDep) -> Visitor | None:
    """Return the visitor, None if not logged in; also stored for the page in `request.state`."""
    text = request.cookies.get(COOKIE)
    request.state.visitor = await run_in_threadpool(find_visitor, services.store, text) if text else None
    return request.state.visitor


async def require_visitor(visitor: Annotated[Visitor | None, Depends(get_visitor)]) -> Visitor:
    """Return the visitor. Raises ProblemError (401) if not logged in."""
    if visitor is None:
        raise ProblemError(HTTPStatus.UNAUTHORIZED, "token", "this page needs a login: log in first")
    return visitor


async def require_team_visitor(visitor: Annotated[Visitor, Depends(require_visitor)]) -> TeamMember:
    """Return the visitor as a member of a team, as `server.api.dependencies.require_team` does. Raises ProblemError."""
    if visitor.caller.team is None:
        raise ProblemError(HTTPStatus.FORBIDDEN, "scope", "token: expected one of a team, found one of none")
    return TeamMember(visitor.caller, visitor.caller.team)


async def require_admin_visitor(visitor: Annotated[Visitor | None, Depends(get_visitor)]) -> Visitor:
    """Return the visitor. Raises NotFound for others than admins."""
    if visitor is None or not visitor.caller.is_admin:
        raise NotFound("there is nothing here")
    return visitor


async def check_same_site(request: Request) -> None:
    """Refuse requests that another site makes the visitor's browser send (CSRF)."""
    if request.method in ("GET", "HEAD", "OPTIONS"):
        return
    site = request.headers.get("sec-fetch-site")
    host = request.headers.get("host")
    if site is not None:
        ours = site in ("same-origin", "none")
    else:
        ours = request.headers.get("origin") in (f"http://{host}", f"https://{host}")
    if not ours:
        sentence = "form: expected to be sent by a page of this server, found another or none"
        raise ProblemError(HTTPStatus.FORBIDDEN, "cross-site", sentence)


def set_token_cookie(request: Request, response: Response, text: str) -> None:
    """Store the token in a cookie that scripts cannot read and other sites cannot send."""
    secure = request.url.scheme == "https"
    response.set_cookie(COOKIE, text, max_age=_KEPT_S, path="/", secure=secure, httponly=True, samesite="strict")


def delete_token_cookie(response: Response) -> None:
    """Delete the cookie."""
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")


OptionalVisitor = Annotated[Visitor | None, Depends(get_visitor)]
AnyVisitor = Annotated[Visitor, Depends(require_visitor)]
TeamVisitor = Annotated[TeamMember, Depends(require_team_visitor)]
AdminVisitor = Annotated[Visitor, Depends(require_admin_visitor)]
