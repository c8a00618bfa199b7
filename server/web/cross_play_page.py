"""The page of cross-play: how agents drive among CAVs of other teams."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from server.api.csv_format import csv_headers, to_csv
from server.api.dependencies import Services, ServicesDep
from server.api.routes import overviews
from server.api.schemas.cross_play import CrossPlayOut
from server.api.schemas.parameters import PHASE_PATTERN
from server.store import phases
from server.tracks import SENSING_LABELS, TRACK_LABELS
from server.web.templating import render_page
from server.web.visitor import OptionalVisitor, Visitor

router = APIRouter()
PhaseQuery = Annotated[str, Query(pattern=PHASE_PATTERN)]


@router.get("/cross-play")
async def show(request: Request, phase: PhaseQuery, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Show the matrix of a phase and the score with strangers."""
    return await services.run_large_read(lambda: _render_board(request, phase, visitor, services))


@router.get("/cross-play.csv")
async def download(phase: PhaseQuery, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Return the matrix as CSV, a line for each pair."""
    board = await services.run_large_read(lambda: _find_board(phase, visitor, services))
    headers = csv_headers(f"cross-play-{phase}") | {"Cache-Control": "no-store"}
    return Response(_format_csv(board), media_type="text/csv", headers=headers)


def _render_board(request: Request, phase: str, visitor: Visitor | None, services: Services) -> Response:
    board = _find_board(phase, visitor, services)
    with services.store.read() as session:
        of_phase = phases.get(session, phase)
        facts = {"title": of_phase.title, "public": of_phase.public}
    return render_page(
        request, "cross_play.html", board=board, phase=facts, tracks=TRACK_LABELS, sensing=SENSING_LABELS
    )


def _find_board(phase: str, visitor: Visitor | None, services: Services) -> CrossPlayOut:
    return overviews.find_cross_play(phase, visitor.caller if visitor is not None else None, services)


def _format_csv(board: CrossPlayOut) -> str:
    names = {agent.submission: (agent.team, agent.method) for agent in board.agents}
    figures = ("ds", "sr", "episodes", "failed", "stopped_others", "left_out")
    header = ("team", "method", "others_team", "others_method", *figures)
    rows = (
        (*names[agent.submission], *names[cell.others], *(getattr(cell, name) for name in figures))
        for agent in board.agents
        for cell in agent.cells
        if not cell.is_own_team
    )
    return to_csv(header, rows)
