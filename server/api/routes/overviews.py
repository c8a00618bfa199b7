"""Overviews of several submissions: compare two, search by name, the matrix of teams and scenarios."""

from typing import Annotated

from fastapi import APIRouter, Query

from server.api.caller import Caller
from server.api.comparison import compare_submissions
from server.api.cross_play_board import read_cross_play
from server.api.dependencies import AdminCaller, OptionalCaller, Services, ServicesDep
from server.api.matrix import read_matrix
from server.api.problems import document_problems
from server.api.schemas.cross_play import CrossPlayOut
from server.api.schemas.leaderboards import SearchOut
from server.api.schemas.parameters import Id, PhaseId, SearchText
from server.api.schemas.scenarios import ComparisonOut, MatrixOut
from server.api.search import search_names
from server.enums import ChallengeTrack

router = APIRouter(tags=["overviews"])
PageNumber = Annotated[int, Query(ge=1, le=10_000)]


@router.get("/submissions/{submission}/compare/{other}", responses=document_problems(401, 404, 422))
async def compare(submission: Id, other: Id, caller: OptionalCaller, services: ServicesDep) -> ComparisonOut:
    """Compare two submissions of one phase, both of which you may see: `other` (B) minus `submission` (A)."""
    return await services.run_large_read(lambda: compare_submissions(submission, other, caller, services))


@router.get("/search", responses=document_problems(401, 422))
async def search(
    q: Annotated[SearchText, Query(description="Part of a name, or an id.")],
    caller: OptionalCaller,
    services: ServicesDep,
) -> SearchOut:
    """Return teams and submissions whose names contain a text: of your team, and those that are shown to everyone."""
    return await services.run_large_read(lambda: find_names(q, caller, services))


@router.get("/phases/{phase}/matrix", responses=document_problems(401, 403, 404, 422))
async def show_matrix(
    phase: PhaseId,
    caller: AdminCaller,
    services: ServicesDep,
    track: ChallengeTrack | None = None,
    page: PageNumber = 1,
) -> MatrixOut:
    """Return DS by team and scenario, for admins; 20 teams per page; without a track, of all tracks but joint."""
    return await services.run_large_read(lambda: find_matrix(phase, track, page, caller, services))


@router.get("/phases/{phase}/cross-play", responses=document_problems(401, 403, 404, 422))
async def show_cross_play(phase: PhaseId, caller: OptionalCaller, services: ServicesDep) -> CrossPlayOut:
    """Return how each agent drives among CAVs of each other; of a hidden phase for admins only."""
    return await services.run_large_read(lambda: find_cross_play(phase, caller, services))


def find_cross_play(phase: str, caller: Caller | None, services: Services) -> CrossPlayOut:
    """Read the board of cross-play in a transaction of its own."""
    with services.store.read() as session:
        return read_cross_play(session, caller, phase)


def find_names(text: str, caller: Caller | None, services: Services) -> SearchOut:
    """Search in a transaction of its own."""
    with services.store.read() as session:
        return search_names(session, caller, text)


def find_matrix(phase: str, track: ChallengeTrack | None, page: int, caller: Caller, services: Services) -> MatrixOut:
    """Read the matrix in a transaction of its own."""
    with services.store.read() as session:
        return read_matrix(session, caller, phase, track, page)
