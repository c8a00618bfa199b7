"""Errors as problem details (RFC 9457), each with one sentence that says what to do."""

import logging
import math
import re
from collections.abc import Awaitable, Callable, Mapping
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import compile_path

from mdrive_sumo.core.errors import InputError
from server.api.schemas.parameters import ID_PATTERN, PHASE_PATTERN, SCENARIO_PATTERN
from server.archive import ArchiveRefused
from server.clock import format_utc
from server.store import NotFound, NotNow, OverLimit, StoreUnavailable

LOG = logging.getLogger("mdrive.requests")
MEDIA_TYPE = "application/problem+json"
TYPE = "urn:mdrive-sumo:problem:"
RETRY_AFTER_S = 5
"""Retry-After where the database does not answer [s]."""


class Problem(BaseModel):
    """RFC 9457. `type` says by machine what `detail` says in a sentence."""

    type: str
    title: str
    status: int
    detail: str
    kind: str | None = None
    """Of a limit: day, parallel, total or refused."""
    retry_at: str | None = None
    """When to come back, in UTC; absent where that does not help."""


class ProblemError(Exception):
    """An error response. `kind` is the last part of the problem's type."""

    def __init__(self, status: HTTPStatus, kind: str, detail: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.kind = kind
        self.detail = detail
        self.headers = dict(headers or {})


class HiddenScenariosError(ProblemError):
    """The request concerns a single hidden scenario."""

    def __init__(self) -> None:
        super().__init__(
            HTTPStatus.FORBIDDEN,
            "hidden",
            "the scenarios of this phase are hidden: only rounded scores of the whole suite are shown",
        )


_DESCRIPTION_BY_STATUS: Mapping[int, str] = {
    400: "The request cannot be read.",
    401: "No token, or one that is not valid.",
    403: "Not allowed with this token, or hidden.",
    404: "There is no such thing, or it is not yours.",
    408: "The request took too long to arrive.",
    409: "Not possible in the present state, e.g. a closed phase.",
    413: "The archive or the body is too large.",
    415: "Another content type is expected.",
    422: "Something in the request is not as expected; the sentence says what.",
    429: "A limit is reached; the sentence and Retry-After say when to try again.",
    503: "The server cannot do it now; try again later.",
}


_PATTERN_WORDS: Mapping[str, str] = {
    ID_PATTERN: "an id of 32 hexadecimal digits",
    PHASE_PATTERN: "the id of a phase: lower-case letters, digits and hyphens, at most 40",
    SCENARIO_PATTERN: "the id of a scenario or CAV: letters, digits and ._+-, at most 80",
}
"""What is expected by a regular expression of `schemas`, in words."""


_STATUS_BY_ERROR = (
    (OverLimit, 429, "over-limit"),
    (NotFound, 404, "not-found"),
    (NotNow, 409, "not-now"),
    (ArchiveRefused, 422, "archive"),
)


def document_problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI responses of these statuses, and of 503, which every route can return."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": _DESCRIPTION_BY_STATUS[status], "content": content} for status in (*statuses, 503)}


def problem_response(
    status: int, problem: str, detail: str, headers: Mapping[str, str] | None = None, **more: str
) -> JSONResponse:
    """Return a problem as a response; `more` are further members of the JSON object."""
    content = {"type": TYPE + problem, "title": HTTPStatus(status).phrase, "status": status, "detail": detail, **more}
    return JSONResponse(content, status, headers=dict(headers or {}), media_type=MEDIA_TYPE)


ErrorPage = Callable[[Request, int, str, Mapping[str, str]], Awaitable[Response]]
"""Renders status, sentence and headers as an HTML page: `app.state.error_page` where pages are mounted."""


def install_handlers(app: FastAPI) -> None:
    """Make every error of `app` a problem; outside /api it becomes a page where pages are mounted."""
    app.exception_handler(ProblemError)(_handle_problem)
    app.exception_handler(InputError)(_handle_input_error)
    app.exception_handler(StoreUnavailable)(_handle_store_unavailable)
    app.exception_handler(RequestValidationError)(_handle_validation_error)
    app.exception_handler(HTTPException)(_handle_http_error)
    app.exception_handler(ClientDisconnect)(_handle_disconnect)
    app.exception_handler(OSError)(_handle_os_error)
    app.exception_handler(Exception)(_handle_internal_error)


async def _respond(
    request: Request, status: int, problem: str, detail: str, headers: Mapping[str, str] | None = None, **more: str
) -> Response:
    detail = hide_paths(detail)
    if not _has_pages(request):
        return problem_response(status, problem, detail, headers, **more)
    page: ErrorPage = request.app.state.error_page
    return await page(request, status, detail, headers or {})


def _has_pages(request: Request) -> bool:
    """Return whether the request is for a page, not for the API."""
    return hasattr(request.app.state, "error_page") and not request.url.path.startswith("/api/")


async def _handle_problem(request: Request, error: ProblemError) -> Response:
    return await _respond(request, error.status, error.kind, error.detail, error.headers)


async def _handle_input_error(request: Request, error: InputError) -> Response:
    if isinstance(error, OverLimit):
        return await _handle_over_limit(request, error)
    return await _respond(request, *find_status(error), str(error))


def find_status(error: InputError) -> tuple[int, str]:
    """Return the HTTP status of an error and the last part of its problem's type."""
    for kind, status, name in _STATUS_BY_ERROR:
        if isinstance(error, kind):
            return status, name
    return 422, "invalid"


async def _handle_over_limit(request: Request, error: OverLimit) -> Response:
    """Add Retry-After, counted from `request.state.now_us`, the time at which the quota was counted."""
    if error.retry_us is None:
        return await _respond(request, 429, "over-limit", str(error), kind=error.kind)
    seconds = max(1, math.ceil((error.retry_us - request.state.now_us) / 1e6))
    again = {"Retry-After": str(seconds)}
    return await _respond(
        request, 429, "over-limit", str(error), again, kind=error.kind, retry_at=format_utc(error.retry_us)
    )


async def _handle_store_unavailable(request: Request, error: StoreUnavailable) -> Response:  # noqa: ARG001 (Starlette's signature)
    """Return 503 without the database's message, which can name files and hosts."""
    return await _respond(
        request,
        503,
        "unavailable",
        "the database does not answer; nothing was changed",
        {"Retry-After": str(RETRY_AFTER_S)},
    )


async def _handle_validation_error(request: Request, error: RequestValidationError) -> Response:
    first: Mapping[str, Any] = error.errors()[0]
    place = " ".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return await _respond(request, 422, "invalid", f"{place}: expected a value, found none")
    if first["type"] == "json_invalid":
        return await _respond(
            request, 422, "invalid", f"body: expected JSON, found other text ({first['ctx']['error']})"
        )
    if first["loc"][0] == "path" and _has_pages(request):
        return await _respond(request, 404, "not-found", f"there is nothing at {request.url.path:.200}")
    pattern: str = first.get("ctx", {}).get("pattern", "")
    said = str(first["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    said = _PATTERN_WORDS.get(pattern, said)
    said = said.replace(" should have ", " with ")
    expected = f"{said[:1].lower()}{said[1:]}".rstrip(".")
    return await _respond(request, 422, "invalid", f"{place}: expected {expected}, found {first['input']!r:.80}")


async def _handle_http_error(request: Request, error: HTTPException) -> Response:
    """Handle the framework's errors: unknown path or method, a body that is not JSON."""
    line = f"{request.method} {request.url.path}"
    sentences = {
        404: f"there is nothing at {line:.200}",
        405: f"{line:.200}: this method is not offered here",
    }
    headers = {**(error.headers or {})}
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED and (methods := _find_methods(request)):
        headers["Allow"] = ", ".join(methods)
    return await _respond(
        request, error.status_code, "http", sentences.get(error.status_code, str(error.detail)), headers
    )


def _find_methods(request: Request) -> list[str]:
    """Return the methods that the described paths of a request offer (RFC 9110, 15.5.6): Starlette names one route's.

    An event stream has no HEAD: see `response_headers`.
    """
    described: Mapping[str, Mapping[str, Any]] = request.app.openapi()["paths"]
    offered = {
        method.upper()
        for path, methods in described.items()
        if _compile(path).match(request.url.path)
        for method in methods
    }
    if "GET" in offered and not request.url.path.endswith("/events"):
        offered.add("HEAD")
    return sorted(offered)


@cache
def _compile(path: str) -> re.Pattern[str]:
    return compile_path(path)[0]


async def _handle_disconnect(request: Request, error: ClientDisconnect) -> Response:  # noqa: ARG001 (Starlette's signature)
    """Log in one line that the client left before its request was complete."""
    line = f"{request.method} {request.url.path}"
    LOG.warning("%r: the client left before its request was complete", line[:200])
    return problem_response(400, "form", "request: expected all of it, found its client gone")


async def _handle_os_error(request: Request, error: OSError) -> Response:
    """Handle a full disk and the like."""
    said = f"the server cannot write: {error.strerror or 'unknown reason'}; nothing was changed"
    return await _respond(request, 503, "unavailable", said, {"Retry-After": "60"})


async def _handle_internal_error(request: Request, error: Exception) -> Response:  # noqa: ARG001
    """Return 500; Starlette raises the error again afterwards, so that the server logs it."""
    return await _respond(request, 500, "ours", "internal error of the server; it is in the server's log")


HIDDEN_PATH = "(a path of the server)"
_PATH = re.compile(r"(?<![\w./:-])/[\w.@+-]+(?:/[\w.@+-]+)+/?")
_NO_SERVER_PATHS = ("/api/", "/agent/")
"""Beginnings of addresses, and of paths inside a box."""


def hide_paths(sentence: str) -> str:
    """Return a sentence without absolute paths whose first folder exists on this machine."""
    return _PATH.sub(lambda found: HIDDEN_PATH if _is_server_path(found[0]) else found[0], sentence)


def _is_server_path(path: str) -> bool:
    return not path.startswith(_NO_SERVER_PATHS) and Path(*Path(path).parts[:2]).is_dir()
