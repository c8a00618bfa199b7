"""Response bodies of leaderboards, of a team's history, and of the search."""

from datetime import datetime

from mdrive_sumo.contract import SensingTrack
from server.api.schemas.parameters import ResponseModel
from server.api.schemas.submissions import FiguresOut, SubmissionOut
from server.enums import ChallengeTrack


class FoundTeamOut(ResponseModel):
    """A team that a search found."""

    id: str
    name: str


class SearchOut(ResponseModel):
    """Teams by name, and submissions with the latest first: at most 20 of each."""

    teams: list[FoundTeamOut]
    submissions: list[SubmissionOut]
    more: bool
    """Whether more were found than are listed."""


class RowOut(ResponseModel):
    """One line of a leaderboard."""

    rank: int | None
    """Null if it is not comparable: driven by another evaluator, or published."""
    team: str
    method: str
    track: ChallengeTrack
    sensing_track: SensingTrack | None
    """sensor: its agent had only what a car carries; object: it was given lists of objects. Ranked apart."""
    submission: str | None
    figures: FiguresOut
    created: datetime | None
    published: bool
    """From the MDrive paper, measured in CARLA: for comparison only."""


class LeaderboardOut(ResponseModel):
    """The best shown submission of each team; ties go to the earlier one. Published results are listed apart."""

    phase: str
    track: ChallengeTrack | None
    bucket: str | None
    category: str | None
    sensing_track: SensingTrack | None
    """Null: both; the rows of each have ranks of their own, those of `object` come first."""
    rows: list[RowOut]
    published: list[RowOut]


class PointOut(ResponseModel):
    """One finished submission in a team's history."""

    submission: str
    method: str
    track: ChallengeTrack
    created: datetime
    ds: float


class HistoryOut(ResponseModel):
    """Finished submissions of a team, the oldest first."""

    team: str
    phase: str
    items: list[PointOut]
