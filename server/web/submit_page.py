"""The form that submits an archive: the same upload, checks and errors as `POST /api/v1/submissions`."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.concurrency import run_in_threadpool

from mdrive_sumo.core.errors import InputError
from server.api.dependencies import Now, Services, ServicesDep
from server.api.problems import ProblemError
from server.api.routes.phases import find_default_phase, list_phases, show_quota
from server.api.schemas.parameters import Id
from server.api.submission_service import receive_submission
from server.api.upload import received_fields
from server.errors import new_id
from server.tracks import TRACK_LABELS
from server.web.templating import describe_refusal, page_headers, render, render_page
from server.web.visitor import TeamVisitor

router = APIRouter()
Key = Annotated[Id | None, Query()]


@router.get("/submit")
def show_form(request: Request, visitor: TeamVisitor, services: ServicesDep, at_us: Now, phase: str = "") -> Response:
    """Show the form."""
    return render_page(
        request, "submit.html", problem="", entered={"phase": phase}, **_form_context(services, visitor, at_us)
    )


@router.post("/submit")
async def send(request: Request, visitor: TeamVisitor, services: ServicesDep, at_us: Now, key: Key = None) -> Response:
    """Accept the archive and redirect to the submission; a refusal is shown on the form, which keeps its input.

    `key` is an idempotency key: the same form sent twice makes one submission.
    """
    try:
        made = await receive_submission(request, services, visitor, key, at_us)
    except (InputError, ProblemError) as error:
        return await _render_refusal(request, visitor, at_us, error)
    target = f"/submissions/{made.id}"
    if _is_htmx(request):
        return Response(status_code=204, headers={"HX-Redirect": target})
    return RedirectResponse(target, 303)


async def _render_refusal(
    request: Request, visitor: TeamVisitor, at_us: int, error: InputError | ProblemError
) -> Response:
    """Return the form with the error; for HTMX, whose form is still on the page with its file, only the error."""
    status, problem, headers = describe_refusal(error, at_us)
    if _is_htmx(request):
        headers = page_headers(True) | dict(headers)
        return HTMLResponse(render("submit_refusal.html", problem=problem), status, headers=headers)
    choices = await run_in_threadpool(_form_context, request.app.state.services, visitor, at_us)
    return render_page(
        request, "submit.html", status, headers, problem=problem, entered=received_fields(request), **choices
    )


def _is_htmx(request: Request) -> bool:
    return request.headers.get("hx-request") == "true"


def _form_context(services: Services, visitor: TeamVisitor, at_us: int) -> dict[str, Any]:
    """Return the choices of the form."""
    listed = list_phases(services, at_us).items
    is_open = sorted((phase for phase in listed if phase.open), key=lambda phase: not phase.public)
    return {
        "open": [(phase, show_quota(phase.id, visitor, services, at_us)) for phase in is_open],
        "default": find_default_phase(listed),
        "others": [phase for phase in listed if not phase.open],
        "tracks": TRACK_LABELS,
        "most": services.settings.limits.archive_bytes,
        "key": new_id(),
    }
