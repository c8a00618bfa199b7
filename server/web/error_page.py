"""Errors as web pages."""

import math
from collections.abc import Mapping
from contextlib import suppress
from http import HTTPStatus

from fastapi import Request, Response

from mdrive_sumo.core.errors import InputError
from server.api.hidden_paths import hide_paths
from server.api.problems import ProblemError, find_status
from server.store import OverLimit, StoreUnavailable
from server.web.templating import render_page
from server.web.visitor import get_visitor


def describe_refusal(error: InputError | ProblemError, at_us: int) -> tuple[int, str, Mapping[str, str]]:
    """Return status, sentence and headers for showing a refusal on its form."""
    if isinstance(error, ProblemError):
        return error.status, hide_paths(error.detail), error.headers
    again_us = error.retry_us if isinstance(error, OverLimit) else None
    headers = {} if again_us is None else {"Retry-After": str(max(1, math.ceil((again_us - at_us) / 1e6)))}
    return find_status(error)[0], hide_paths(str(error)), headers


async def render_error(request: Request, status: int, detail: str, headers: Mapping[str, str]) -> Response:
    """Render a problem as a page; `server.api.problems` calls this outside /api."""
    if not hasattr(request.state, "visitor"):
        with suppress(StoreUnavailable):
            await get_visitor(request, request.app.state.services)
    title = HTTPStatus(status).phrase
    return render_page(
        request, "error.html", status, headers, title=title, detail=detail, log_in=status == HTTPStatus.UNAUTHORIZED
    )
