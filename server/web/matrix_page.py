"""The page of teams and scenarios, for admins; others get 404."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field

from server.api.csv_format import csv_headers, to_csv
from server.api.dependencies import Services, ServicesDep
from server.api.routes import overviews
from server.api.schemas.scenarios import MatrixOut
from server.enums import ChallengeTrack
from server.store import phases
from server.tracks import TRACK_LABELS
from server.web.templating import render_page
from server.web.visitor import AdminVisitor, Visitor

router = APIRouter(prefix="/admin")


class MatrixView(BaseModel):
    """The part of the matrix that a page shows."""

    phase: Annotated[str, Field(max_length=40)] = ""
    """The one that opened last if it is empty."""
    track: ChallengeTrack | Literal[""] = ""
    """All but joint if it is empty."""
    sort: Literal["scenario", "ds", "failed"] = "scenario"
    page: Annotated[int, Field(ge=1, le=10_000)] = 1


ViewDep = Annotated[MatrixView, Query()]


@router.get("/matrix")
async def show(request: Request, view: ViewDep, visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Show DS of teams in each scenario of a phase."""
    return await services.run_large_read(lambda: _render_matrix(request, view, visitor, services))


@router.get("/matrix.csv")
async def download(view: ViewDep, visitor: AdminVisitor, services: ServicesDep) -> Response:
    """Return the teams of a page of the matrix as CSV."""
    found = await services.run_large_read(lambda: _find_matrix(view, view.phase, visitor, services))
    rows = (
        (row.scenario, row.bucket, row.category, row.ds, row.failed, *(cell.ds if cell else None for cell in row.cells))
        for row in found.rows
    )
    header = ("scenario", "bucket", "category", "mean", "failed", *(column.team for column in found.columns))
    headers = csv_headers(f"matrix-{found.phase}") | {"Cache-Control": "no-store"}
    return Response(to_csv(header, rows), media_type="text/csv", headers=headers)


def _render_matrix(request: Request, view: MatrixView, visitor: Visitor, services: Services) -> Response:
    with services.store.read() as session:
        known = phases.list_phases(session)
    chosen = view.phase or (known[-1].id if known else "")
    matrix = _find_matrix(view, chosen, visitor, services) if chosen else None
    rows = list(matrix.rows) if matrix is not None else []
    if view.sort != "scenario":
        rows.sort(key=lambda row: row.ds if view.sort == "ds" else -row.failed)
    context: dict[str, Any] = {"matrix": matrix, "rows": rows, "phases": known, "sort": view.sort}
    public = any(each.public for each in known if each.id == chosen)
    return render_page(request, "admin_matrix.html", public=public, tracks=TRACK_LABELS, **context)


def _find_matrix(view: MatrixView, phase: str, visitor: Visitor, services: Services) -> MatrixOut:
    track = ChallengeTrack(view.track) if view.track else None
    return overviews.find_matrix(phase, track, view.page, visitor.caller, services)
