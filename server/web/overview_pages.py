"""Pages over several submissions: compare two, search, results as CSV, how agents drive among CAVs of other teams."""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from server.api import submission_views
from server.api.comparison import compare_submissions
from server.api.cross_play_board import CrossPlayOut, read_cross_play
from server.api.csv_format import csv_headers, to_csv
from server.api.dependencies import Now, Services, ServicesDep
from server.api.ranking_board import RankedSubmissionOut
from server.api.routes import results
from server.api.routes.overviews import find_ranking, search_names
from server.api.schemas.parameters import PHASE_PATTERN, Id
from server.api.submission_views import Caller
from server.enums import SubmissionState
from server.store import phases, tables
from server.tracks import SENSING_LABELS, TRACK_LABELS
from server.web import explanations
from server.web.templating import render_page
from server.web.visitor import OptionalVisitor, Visitor

router = APIRouter()
MAX_CHOICES = 100
"""Submissions that the page of a comparison offers."""
PhaseQuery = Annotated[str, Query(pattern=PHASE_PATTERN)]


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
async def download_scenarios(submission: Id, visitor: OptionalVisitor, services: ServicesDep) -> Response:
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
    read = partial(search_names, services.store, caller, text)
    names = await services.run_large_read(read) if is_usable else None
    return render_page(request, "search.html", text=text, found=names, tracks=TRACK_LABELS, explanations=explanations)


def _render_comparison(
    request: Request, submission: str, other: str | None, caller: Caller | None, services: Services
) -> Response:
    with services.store.read() as session:
        first = submission_views.find_visible(session, caller, submission)
        shown = submission_views.to_submission(session, caller, first)
        choices = _list_choices(session, caller, first)
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


@router.get("/cross-play")
async def show_cross_play(
    request: Request, phase: PhaseQuery, visitor: OptionalVisitor, services: ServicesDep
) -> Response:
    """Show the matrix of a phase and the score with strangers."""
    return await services.run_large_read(lambda: _render_board(request, phase, visitor, services))


@router.get("/cross-play.csv")
async def download_cross_play(phase: PhaseQuery, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Return the matrix as CSV, a line for each pair."""
    board = await services.run_large_read(lambda: _find_board(phase, visitor, services))
    headers = csv_headers(f"cross-play-{phase}") | {"Cache-Control": "no-store"}
    return Response(_format_cross_play(board), media_type="text/csv", headers=headers)


@router.get("/ranking")
async def show_ranking(request: Request, phase: PhaseQuery, services: ServicesDep, at_us: Now) -> Response:
    """Show the ranking of a public phase by item response."""
    ranking = await find_ranking(phase, services, at_us)
    title = await services.run_large_read(lambda: _find_title(phase, services))
    return render_page(
        request, "ranking.html", ranking=ranking, title=title, tracks=TRACK_LABELS, sensing=SENSING_LABELS
    )


@router.get("/ranking.csv")
async def download_ranking(phase: PhaseQuery, services: ServicesDep, at_us: Now) -> Response:
    """Return the ranking as CSV."""
    ranking = await find_ranking(phase, services, at_us)
    header = tuple(RankedSubmissionOut.model_fields)
    rows = (tuple(getattr(agent, name) for name in header) for agent in ranking.agents)
    headers = csv_headers(f"ranking-{phase}") | {"Cache-Control": "no-cache"}
    return Response(to_csv(header, rows), media_type="text/csv", headers=headers)


def _find_title(phase: str, services: Services) -> str:
    with services.store.read() as session:
        return phases.get(session, phase).title


def _render_board(request: Request, phase: str, visitor: Visitor | None, services: Services) -> Response:
    board = _find_board(phase, visitor, services)
    with services.store.read() as session:
        of_phase = phases.get(session, phase)
        facts = {"title": of_phase.title, "public": of_phase.public}
    return render_page(
        request, "cross_play.html", board=board, phase=facts, tracks=TRACK_LABELS, sensing=SENSING_LABELS
    )


def _find_board(phase: str, visitor: Visitor | None, services: Services) -> CrossPlayOut:
    return read_cross_play(services.store, visitor.caller if visitor is not None else None, phase)


def _format_cross_play(board: CrossPlayOut) -> str:
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
