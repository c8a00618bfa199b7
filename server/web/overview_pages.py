"""Pages over several submissions: compare two, search, the results of one as CSV."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from server.api import submission_views
from server.api.caller import Caller
from server.api.comparison import compare_submissions
from server.api.dependencies import Services, ServicesDep
from server.api.routes import overviews, results
from server.api.schemas.parameters import Id
from server.enums import SubmissionState
from server.store import tables
from server.tracks import TRACK_LABELS
from server.web import explanations
from server.web.templating import render_page
from server.web.visitor import OptionalVisitor

router = APIRouter()
MAX_CHOICES = 100
"""Submissions that the page of a comparison offers."""


@router.get("/submissions/{submission}/compare")
async def compare(
    request: Request,
    submission: Id,
    visitor: OptionalVisitor,
    services: ServicesDep,
    other: Annotated[Id | None, Query()] = None,
) -> Response:
    """Show a submission beside another one of its phase; without `other` only the choice."""
    caller = visitor.caller if visitor is not None else None
    return await services.run_large_read(lambda: _render_comparison(request, submission, other, caller, services))


@router.get("/submissions/{submission}/scenarios.csv")
async def download(submission: Id, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Return the results of a submission as CSV."""
    caller = visitor.caller if visitor is not None else None
    answer = await results.download_scenarios(submission, caller, services)
    answer.headers["Cache-Control"] = "no-store" if caller is not None else "no-cache"
    answer.headers["Vary"] = "Cookie"
    return answer


@router.get("/search")
async def search(
    request: Request,
    visitor: OptionalVisitor,
    services: ServicesDep,
    q: Annotated[str, Query(max_length=80)] = "",
) -> Response:
    """Search teams and submissions by name."""
    text, caller = q.strip(), visitor.caller if visitor is not None else None
    is_usable = len(text) > 1 and text.isprintable()
    found = await services.run_large_read(lambda: overviews.find_names(text, caller, services)) if is_usable else None
    return render_page(request, "search.html", text=text, found=found, tracks=TRACK_LABELS, explanations=explanations)


def _render_comparison(
    request: Request, submission: str, other: str | None, caller: Caller | None, services: Services
) -> Response:
    with services.store.read() as session:
        found = submission_views.find_visible(session, caller, submission)
        shown = submission_views.to_submission(session, caller, found)
        choices = _list_choices(session, caller, found)
    comparison = compare_submissions(submission, other, caller, services) if other is not None else None
    return render_page(
        request,
        "compare.html",
        it=shown,
        choices=choices,
        comparison=comparison,
        tracks=TRACK_LABELS,
        explanations=explanations,
    )


def _list_choices(
    session: Session, caller: Caller | None, submission: tables.SubmissionRow
) -> list[tuple[tables.SubmissionRow, str]]:
    """Return finished submissions of the same phase with their teams' names: those of the same team first."""
    row, team = tables.SubmissionRow, tables.TeamRow
    wanted = (
        select(row, team.name)
        .join(team, team.id == row.team)
        .where(
            submission_views.is_visible(caller),
            row.phase == submission.phase,
            row.id != submission.id,
            or_(row.state == SubmissionState.DONE.value, row.state == SubmissionState.DISQUALIFIED.value),
        )
        .order_by((row.team == submission.team).desc(), row.created_us.desc(), row.id)
    )
    return [(each, name) for each, name in session.execute(wanted.limit(MAX_CHOICES))]
