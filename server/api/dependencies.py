"""Dependencies of the routes: services, the time of the request, the authenticated caller."""

from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Annotated, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request
from fastapi.security import HTTPBearer
from starlette.concurrency import run_in_threadpool

from server.api.check_queue import CheckQueue
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.event_watch import EventWatch
from server.api.leaderboard_cache import LeaderboardCache
from server.api.problems import ProblemError
from server.api.submission_views import Caller, TeamMember, find_caller
from server.api.subprocess_runner import CallRunner
from server.enums import TokenScope
from server.phase_suites import PhaseSuites
from server.settings import ServerSettings
from server.store import Store

MAX_LARGE_READS = 1
"""Lists of a submission's scenarios made at a time: each occupies the interpreter. Others wait without a thread, so
that they delay neither uploads nor the health check."""
CHECKERS = 2
"""Processes that check archives: one team can occupy all but one of them."""
_R = TypeVar("_R")
_BEARER = "Bearer "
OPTIONAL_TOKEN = "OptionalToken"
"""OpenAPI: name of the scheme of operations that anyone may call and that tell the holder of a token more."""
_optional_scheme = HTTPBearer(auto_error=False, scheme_name=OPTIONAL_TOKEN)
_scheme = HTTPBearer(auto_error=False, description="A token of a team or of an admin.")
"""For OpenAPI only: `get_optional_caller` reads the header itself to distinguish a wrong token from none."""


@dataclass(frozen=True, slots=True)
class Services:
    """Shared objects of the application, in `app.state.services`."""

    settings: ServerSettings
    store: Store
    suites: PhaseSuites
    check_runner: CallRunner
    """Checks uploaded archives."""
    replay_runner: CallRunner
    """Writes replay pages; apart, because a page takes seconds and uploads must not wait for it."""
    leaderboards: LeaderboardCache
    upload_limit: ConcurrencyLimit
    stream_limit: ConcurrencyLimit
    event_watch: EventWatch = field(default_factory=EventWatch)
    check_queue: CheckQueue = field(default_factory=lambda: CheckQueue(CHECKERS))
    check_threads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(CHECKERS))
    large_reads: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(MAX_LARGE_READS))
    health_thread: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))

    async def run_large_read(self, function: Callable[[], _R]) -> _R:
        """Run a function that reads and formats much in a thread, at most `MAX_LARGE_READS` at a time."""
        return await to_thread.run_sync(function, limiter=self.large_reads)

    async def run_health_check(self, function: Callable[[], _R]) -> _R:
        """Run a function in a thread that is free even if those of all other requests are busy."""
        return await to_thread.run_sync(function, limiter=self.health_thread)


async def get_services(request: Request) -> Services:
    """Return the services of the application."""
    return request.app.state.services


async def get_now(request: Request) -> int:
    """Return the time of this request [us since 1970]; the clock is read once."""
    request.state.now_us = request.app.state.now()
    return request.state.now_us


ServicesDep = Annotated[Services, Depends(get_services)]
Now = Annotated[int, Depends(get_now)]


async def get_optional_caller(
    request: Request, services: ServicesDep, _described: Annotated[object, Depends(_optional_scheme)]
) -> Caller | None:
    """Return the caller, None without a token. Raises ProblemError (401) for an invalid token."""
    header = request.headers.get("authorization")
    if header is None:
        return None
    text = header[len(_BEARER) :].strip() if header[: len(_BEARER)].lower() == _BEARER.lower() else ""
    caller = await run_in_threadpool(find_caller, services.store, text) if text else None
    if caller is None:
        raise _unauthorized("token: expected one that is valid, found none: it may be mistyped or revoked")
    return caller


async def require_caller(
    caller: Annotated[Caller | None, Depends(get_optional_caller)], _described: Annotated[object, Depends(_scheme)]
) -> Caller:
    """Return the caller. Raises ProblemError (401) without a token."""
    if caller is None:
        raise _unauthorized("token: expected the header `Authorization: Bearer TOKEN`, found none")
    return caller


async def require_admin(caller: Annotated[Caller, Depends(require_caller)]) -> Caller:
    """Return the caller. Raises ProblemError (403) for others than admins."""
    if not caller.is_admin:
        raise _forbidden(TokenScope.ADMIN)
    return caller


async def require_team(caller: Annotated[Caller, Depends(require_caller)]) -> TeamMember:
    """Return the caller and the id of its team. Raises ProblemError (403) for tokens without a team."""
    if caller.team is None:
        raise _forbidden(TokenScope.SUBMIT)
    return TeamMember(caller, caller.team)


async def require_operator(caller: Annotated[Caller, Depends(require_caller)]) -> Caller:
    """Return the caller. Raises ProblemError (403) for others than admins and workers."""
    if caller.scope is TokenScope.SUBMIT:
        raise _forbidden(TokenScope.WORKER)
    return caller


OptionalCaller = Annotated[Caller | None, Depends(get_optional_caller)]
AnyCaller = Annotated[Caller, Depends(require_caller)]
AdminCaller = Annotated[Caller, Depends(require_admin)]
TeamCaller = Annotated[TeamMember, Depends(require_team)]
OperatorCaller = Annotated[Caller, Depends(require_operator)]


def _unauthorized(sentence: str) -> ProblemError:
    return ProblemError(HTTPStatus.UNAUTHORIZED, "token", sentence, {"WWW-Authenticate": "Bearer"})


def _forbidden(scope: TokenScope) -> ProblemError:
    return ProblemError(HTTPStatus.FORBIDDEN, "scope", f"token: expected one with the scope {scope}, found another")
