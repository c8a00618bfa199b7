"""Renders pages from templates, always escaped, with a content security policy."""

import math
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from http import HTTPStatus
from typing import Any

from fastapi import Request, Response
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.core.errors import InputError
from server.api.problems import ProblemError, find_status, hide_paths
from server.api.schemas.submissions import FiguresOut
from server.clock import format_utc
from server.store import OverLimit, StoreUnavailable
from server.web.static_files import static_url
from server.web.visitor import get_visitor

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "frame-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
"""No inline script, no inline style, nothing from other hosts."""


def render_page(
    request: Request,
    template: str,
    status: int = HTTPStatus.OK,
    headers: Mapping[str, str] | None = None,
    **context: Any,
) -> HTMLResponse:
    """Render a template as a response, with `visitor` as found by a dependency (None without)."""
    visitor = getattr(request.state, "visitor", None)
    text = render(template, visitor=visitor, **context)
    return HTMLResponse(text, status, headers=page_headers(visitor is not None) | dict(headers or {}))


def render(template: str, **context: Any) -> str:
    """Render a template."""
    return _environment.get_template(template).render(context)


def page_headers(personal: bool) -> dict[str, str]:
    """Return the headers of a page; `personal`: its contents are for one visitor only."""
    return {
        "Content-Security-Policy": POLICY,
        "Cache-Control": "no-store" if personal else "no-cache",
        "Vary": "Cookie",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
    }


def format_percent(value: float | None) -> str:
    """Format as 85.3; a dash if unknown."""
    return "–" if value is None else f"{value:.1f}"


def format_ratio(value: float | None) -> str:
    """Format as 0.97; a dash if unknown."""
    return "–" if value is None else f"{value:.2f}"


def format_interval(figures: FiguresOut, name: str) -> str:
    """Format the interval of `ds` or `sr` as [80.1, 90.2]; "" if unknown, as for too few scenarios."""
    low, high = getattr(figures, f"{name}_low"), getattr(figures, f"{name}_high")
    return "" if low is None or high is None else f"[{low:.1f}, {high:.1f}]"


def format_time(moment: datetime | int | None) -> str:
    """Format a time (an int is microseconds since 1970) in UTC."""
    if moment is None:
        return "–"
    return format_utc(moment if isinstance(moment, int) else int(moment.timestamp() * 1e6))


def format_day(moment: datetime | int | None) -> str:
    """Format the UTC day: 2026-01-31."""
    return format_time(moment)[:10]


def format_size(number: int | None) -> str:
    """Format as 12.5 MB, with decimal units."""
    if number is None:
        return "–"
    value, unit = float(number), "bytes"
    for larger in ("kB", "MB", "GB", "TB"):
        if value < 1000:
            break
        value, unit = value / 1000, larger
    return f"{value:.0f} {unit}" if unit == "bytes" else f"{value:.1f} {unit}"


def format_binary_size(number: int) -> str:
    """Format as 64 MiB, for limits, which are powers of two."""
    return f"{round(number / 1024**2, 1):g} MiB" if number >= 1024**2 else f"{round(number / 1024, 1):g} KiB"


def _make_environment() -> Environment:
    made = Environment(
        loader=PackageLoader("server.web"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=clean_for_page,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(
        percent=format_percent,
        ratio=format_ratio,
        at=format_time,
        day=format_day,
        size=format_size,
        binary=format_binary_size,
    )
    more: dict[str, Any] = {"interval": format_interval, "static": static_url}
    made.globals.update(more)
    return made


_environment = _make_environment()


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
