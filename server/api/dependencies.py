"""What requests are answered with: the store, the settings, the clock, and who asks."""

from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from starlette.concurrency import run_in_threadpool

from server.api.caller import Caller, holder
from server.api.concurrency_limit import AtOnce
from server.api.leaderboard_cache import Boards
from server.api.problems import ProblemError
from server.api.subprocess_runner import Aside
from server.api.upload import Uploads
from server.enums import Scope
from server.phase_suites import Suites
from server.settings import Settings
from server.store import Store

STREAMS = 16
"""Of events, at a time, of one team: each asks the database once a second."""
_BEARER = "Bearer "
_scheme = HTTPBearer(auto_error=False, description="A token of a team or of an admin.")
"""For the description only: `anyone` reads the header itself, to tell a wrong one from none."""


@dataclass(frozen=True, slots=True)
class Tools:
    """What the application is made of, in `app.state.tools`."""

    settings: Settings
    store: Store
    suites: Suites
    aside: Aside
    """Reads what strangers sent, in a process of its own."""
    painter: Aside
    """Makes replay pages: another process, for that takes seconds, and uploads are not to wait for it."""
    boards: Boards
    uploads: Uploads
    streams: AtOnce = field(default_factory=lambda: AtOnce("stream of events", STREAMS))


async def tools(request: Request) -> Tools:
    """Of the application."""
    return request.app.state.tools


async def now(request: Request) -> int:
    """The time of this request: the clock is read once."""
    request.state.now_us = request.app.state.now()
    return request.state.now_us


ToolsOf = Annotated[Tools, Depends(tools)]
Now = Annotated[int, Depends(now)]


async def anyone(request: Request, using: ToolsOf, _described: Annotated[object, Depends(_scheme)]) -> Caller | None:
    """Who asks; None for nobody we know."""
    header = request.headers.get("authorization")
    if header is None:
        return None
    text = header[len(_BEARER) :].strip() if header[: len(_BEARER)].lower() == _BEARER.lower() else ""
    found = await run_in_threadpool(holder, using.store, text) if text else None
    if found is None:
        raise _unknown("token: expected one that is valid, found none: it may be mistyped or revoked")
    return found


async def somebody(caller: Annotated[Caller | None, Depends(anyone)]) -> Caller:
    """Who asks, with any token."""
    if caller is None:
        raise _unknown("token: expected the header `Authorization: Bearer TOKEN`, found none")
    return caller


async def admin(caller: Annotated[Caller, Depends(somebody)]) -> Caller:
    """An admin."""
    if not caller.is_admin:
        raise _forbidden(Scope.ADMIN)
    return caller


async def member(caller: Annotated[Caller, Depends(somebody)]) -> tuple[Caller, str]:
    """A team's token, and the team's id."""
    if caller.team is None:
        raise _forbidden(Scope.SUBMIT)
    return caller, caller.team


async def watcher(caller: Annotated[Caller, Depends(somebody)]) -> Caller:
    """An admin or a worker: who may see how the server is doing."""
    if caller.scope is Scope.SUBMIT:
        raise _forbidden(Scope.WORKER)
    return caller


Anyone = Annotated[Caller | None, Depends(anyone)]
Somebody = Annotated[Caller, Depends(somebody)]
Admin = Annotated[Caller, Depends(admin)]
Member = Annotated[tuple[Caller, str], Depends(member)]
Watcher = Annotated[Caller, Depends(watcher)]


def _unknown(sentence: str) -> ProblemError:
    return ProblemError(HTTPStatus.UNAUTHORIZED, "token", sentence, {"WWW-Authenticate": "Bearer"})


def _forbidden(scope: Scope) -> ProblemError:
    return ProblemError(HTTPStatus.FORBIDDEN, "scope", f"token: expected one with the scope {scope}, found another")
