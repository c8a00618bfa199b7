"""Leaderboards: who stands where, and how a team came there."""

from fastapi import APIRouter, Response

from mdrive_sumo.core.errors import InputError
from server.api import schemas
from server.api.dependencies import Now, ServicesDep
from server.api.leaderboard_cache import BoardKey
from server.api.problems import document_problems
from server.api.schemas import to_datetime
from server.enums import ChallengeTrack, SubmissionState
from server.store import NotFound, phases, queries, teams

router = APIRouter(tags=["leaderboards"])


@router.get("/leaderboards/{phase}", response_model=schemas.LeaderboardOut, responses=document_problems(404, 422))
async def show_leaderboard(
    phase: schemas.PhaseId,
    using: ServicesDep,
    at_us: Now,
    track: ChallengeTrack | None = None,
    bucket: schemas.PartName | None = None,
    category: schemas.PartName | None = None,
) -> Response:
    """Overall, of one bucket, or of one category; without a track: all in which every CAV decides for itself.

    In a hidden phase a bucket or category is shown where at least 5 scenarios are in it. A board can be seconds old.
    """
    if bucket is not None and category is not None:
        raise InputError(f"leaderboard: expected a bucket or a category, found both: {bucket!r} and {category!r}")
    content = await using.boards.board(BoardKey(phase, track, bucket, category), at_us)
    return Response(content, media_type="application/json")


@router.get("/leaderboards/{phase}/teams/{team}", responses=document_problems(404, 422))
def show_history(phase: schemas.PhaseId, team: schemas.TeamName, using: ServicesDep) -> schemas.HistoryOut:
    """Every finished submission of a team (name or id) that it shows."""
    with using.store.read() as session:
        found = teams.get(session, team)
        if found.hidden:
            raise NotFound(f"team: there is no {team!r}")
        all_of_team = queries.list_history(session, found.id, phases.get(session, phase).id)
        items = [
            schemas.PointOut(
                submission=each.id,
                method=each.name,
                track=ChallengeTrack(each.track),
                created=to_datetime(each.created_us),
                ds=each.ds,
            )
            for each in all_of_team
            if each.state == SubmissionState.DONE and each.shown and each.ds is not None
        ]
        return schemas.HistoryOut(team=found.name, phase=phase, items=items)
