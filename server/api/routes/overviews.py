"""Overviews of several submissions: compare two, search by name, the matrix of teams and scenarios."""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query
from sqlalchemy import or_, select

from server.api import submission_views
from server.api.comparison import compare_submissions
from server.api.cross_play_board import CrossPlayOut, read_cross_play
from server.api.dependencies import AdminCaller, Now, OptionalCaller, Services, ServicesDep
from server.api.matrix import read_matrix
from server.api.problems import document_problems
from server.api.ranking_board import RankingOut, read_ranking
from server.api.schemas.leaderboards import FoundTeamOut, SearchOut
from server.api.schemas.parameters import Id, PhaseId, SearchText
from server.api.schemas.scenarios import ComparisonOut, MatrixOut
from server.api.submission_views import Caller
from server.enums import ChallengeTrack
from server.store import Store
from server.store.tables import SubmissionRow, TeamRow

router = APIRouter(tags=["overviews"])
PageNumber = Annotated[int, Query(ge=1, le=10_000)]
MAX_FOUND = 20
"""Teams, and submissions, of one answer."""


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
    return await services.run_large_read(lambda: search_names(services.store, caller, q))


@router.get("/phases/{phase}/matrix", responses=document_problems(401, 403, 404, 422))
async def show_matrix(
    phase: PhaseId,
    caller: AdminCaller,
    services: ServicesDep,
    track: ChallengeTrack | None = None,
    page: PageNumber = 1,
) -> MatrixOut:
    """Return DS by team and scenario, for admins; 20 teams per page; without a track, of all tracks but joint."""
    return await services.run_large_read(lambda: read_matrix(services.store, caller, phase, track, page))


@router.get("/phases/{phase}/cross-play", responses=document_problems(401, 403, 404, 422))
async def show_cross_play(phase: PhaseId, caller: OptionalCaller, services: ServicesDep) -> CrossPlayOut:
    """Return how each agent drives among CAVs of each other; of a hidden phase for admins only."""
    return await services.run_large_read(lambda: read_cross_play(services.store, caller, phase))


@router.get("/phases/{phase}/ranking", responses=document_problems(403, 404, 422))
async def show_ranking(phase: PhaseId, services: ServicesDep, at_us: Now) -> RankingOut:
    """Return abilities by item response with ranks, ties and intervals; of a public phase only."""
    return await find_ranking(phase, services, at_us)


async def find_ranking(phase: str, services: Services, at_us: int) -> RankingOut:
    """Return the ranking of a phase, which is computed anew when a board may have changed."""
    return await services.leaderboards.get(("ranking", phase), partial(read_ranking, phase_id=phase), at_us)


def search_names(store: Store, caller: Caller | None, text: str) -> SearchOut:
    """Return what contains the text in its name or has it as its id; upper and lower case are the same (ASCII).

    Teams are found by everyone only if a visible submission shows their name anyway.
    """
    visible = submission_views.is_visible(caller)
    shown_teams = select(SubmissionRow.team).where(visible)
    team_names = or_(TeamRow.name.icontains(text, autoescape=True), TeamRow.id == text)
    method_names = or_(SubmissionRow.name.icontains(text, autoescape=True), SubmissionRow.id == text)
    own = caller.team if caller is not None else None
    is_admin = caller is not None and caller.is_admin
    teams = select(TeamRow).where(team_names)
    if not is_admin:
        teams = teams.where(or_(TeamRow.id.in_(shown_teams), TeamRow.id == own))
    order = (SubmissionRow.created_us.desc(), SubmissionRow.id)
    submissions = select(SubmissionRow).where(visible, method_names).order_by(*order)
    with store.read() as session:
        found_teams = session.scalars(teams.order_by(TeamRow.name).limit(MAX_FOUND + 1)).all()
        methods = session.scalars(submissions.limit(MAX_FOUND + 1)).all()
        return SearchOut(
            teams=[FoundTeamOut(id=team.id, name=team.name) for team in found_teams[:MAX_FOUND]],
            submissions=[submission_views.to_submission(session, caller, each) for each in methods[:MAX_FOUND]],
            more=max(len(found_teams), len(methods)) > MAX_FOUND,
        )
