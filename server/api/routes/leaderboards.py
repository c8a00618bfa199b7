"""Leaderboards, and the history of a team."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Depends, Response

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.core.errors import InputError
from server.api import submission_views
from server.api.dependencies import Now, ServicesDep
from server.api.leaderboards import BoardKey
from server.api.problems import document_problems
from server.api.schemas.leaderboards import HistoryOut, LeaderboardOut, PointOut
from server.api.schemas.parameters import PartName, PhaseId, TeamName, to_datetime
from server.enums import ChallengeTrack, SubmissionState
from server.store import NotFound, phases, queries, teams


@dataclass(frozen=True, slots=True)
class TrackFilter:
    """The tracks of a board."""

    track: ChallengeTrack | None = None
    sensing_track: SensingTrack | None = None


router = APIRouter(tags=["leaderboards"])


@router.get("/leaderboards/{phase}", response_model=LeaderboardOut, responses=document_problems(404, 422))
async def show_leaderboard(
    phase: PhaseId,
    services: ServicesDep,
    at_us: Now,
    tracks: Annotated[TrackFilter, Depends()],
    bucket: PartName | None = None,
    category: PartName | None = None,
) -> Response:
    """Return the overall leaderboard, or that of a bucket or a category; without a track, of all tracks but joint.

    The sensing tracks are ranked apart; without one, the rows of `object` come first, then those of `sensor`.
    Of a hidden phase it shows the overall DS to 0.1 and SR to 1 %, and no bucket or category. The result can be seconds
    old.
    """
    if bucket is not None and category is not None:
        raise InputError(f"leaderboard: expected a bucket or a category, found both: {bucket!r} and {category!r}")
    content = await services.leaderboards.get_json(
        BoardKey(phase, tracks.track, bucket, category, tracks.sensing_track), at_us
    )
    return Response(content, media_type="application/json")


@router.get("/leaderboards/{phase}/teams/{team}", responses=document_problems(404, 422))
def show_history(phase: PhaseId, team: TeamName, services: ServicesDep) -> HistoryOut:
    """Return every finished submission of a team (name or id) that it shows."""
    with services.store.read() as session:
        named = teams.get(session, team)
        if named.hidden:
            raise NotFound(f"team: there is no {team!r}")
        of_phase = phases.get(session, phase)
        all_of_team = queries.list_history(session, named.id, of_phase.id)
        items = [
            PointOut(
                submission=each.id,
                method=each.name,
                track=ChallengeTrack(each.track),
                created=to_datetime(each.created_us),
                ds=submission_views.visible_ds(of_phase, each.ds),
            )
            for each in all_of_team
            if each.state == SubmissionState.DONE and each.shown and each.ds is not None
        ]
        return HistoryOut(team=named.name, phase=phase, items=items)
