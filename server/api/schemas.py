"""What goes in and out, as the OpenAPI description shows it. Times are ISO 8601 in UTC."""

from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from server.enums import ChallengeTrack, JobState, SubmissionState, TokenScope


def to_datetime(at_us: int) -> datetime:
    """As the API writes times."""
    return datetime.fromtimestamp(at_us / 1e6, UTC)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("printable characters")
    return text


TeamName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable)]
"""Of a team, or its id."""
Id = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
PhaseId = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]
ScenarioId = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}$")]
"""As in scenario files; also of a CAV."""
Seed = Annotated[int, Field(ge=0, le=1_000_000)]
PartName = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_printable)]
"""A bucket or a category."""


class RequestModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class ResponseModel(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class NewTeamIn(RequestModel):
    """A team to be made."""

    name: TeamName


class HideIn(RequestModel):
    """Whether a team stands on leaderboards."""

    hidden: bool


class NewTokenIn(RequestModel):
    """`submit` needs a team, `admin` and `worker` have none."""

    scope: TokenScope = TokenScope.SUBMIT
    team: TeamName | None = None


class ShowIn(RequestModel):
    """Whether a submission may stand on the leaderboard."""

    shown: bool


class ReasonIn(RequestModel):
    """Shown to everybody who may see the submission."""

    reason: Annotated[str, Field(min_length=1, max_length=500), AfterValidator(_printable)]


class TeamOut(ResponseModel):
    """Who submits."""

    id: str
    name: str
    created: datetime
    hidden: bool


class TeamsOut(ResponseModel):
    """All teams."""

    items: list[TeamOut]


class TokenOut(ResponseModel):
    """What is known of a token: never its text."""

    id: str
    team: str | None
    scope: TokenScope
    created: datetime
    revoked: datetime | None


class TokensOut(ResponseModel):
    """The oldest first."""

    items: list[TokenOut]


class IssuedTokenOut(ResponseModel):
    """The only time that anyone sees the text."""

    token: str


class RegisteredOut(ResponseModel):
    """A team that made itself. Nobody sees the token again."""

    team: TeamOut
    token: str


class MeOut(ResponseModel):
    """Who holds the token."""

    scope: TokenScope
    team: TeamOut | None


class PhaseOut(ResponseModel):
    """When submissions are taken, on what, and how many of a team."""

    id: str
    title: str
    suite: str | None
    """Name of the suite; null where it is hidden."""
    public: bool
    open: bool
    opens: datetime
    closes: datetime
    per_day: int
    in_parallel: int
    in_total: int
    seeds: int


class PhasesOut(ResponseModel):
    """In the order in which they open."""

    items: list[PhaseOut]


class QuotaOut(ResponseModel):
    """What a team has used of a phase; the limits are those of the phase."""

    today: int
    in_parallel: int
    in_total: int


class FiguresOut(ResponseModel):
    """Means of a submission over all its scenarios, one bucket or one category. DS, SR and RC in percent."""

    ds: float
    sr: float | None = None
    rc: float | None = None
    ip: float | None = None
    ds_low: float | None = None
    ds_high: float | None = None
    sr_low: float | None = None
    sr_high: float | None = None
    scenarios: int | None = None
    infractions: dict[str, int] | None = None


class SummaryOut(ResponseModel):
    """The result of a submission."""

    overall: FiguresOut
    buckets: dict[str, FiguresOut]
    categories: dict[str, FiguresOut]


class QueueOut(ResponseModel):
    """What is before an unfinished submission."""

    position: int
    """1: nothing waits before it."""
    eta_s: int | None
    """In minutes' steps; null where it is not known or would tell about hidden scenarios."""


class SubmissionOut(ResponseModel):
    """One archive in one phase."""

    id: str
    team: str
    """Its name."""
    phase: str
    track: ChallengeTrack
    name: str
    state: SubmissionState
    why: str
    """One sentence where it was rejected, disqualified or failed."""
    created: datetime
    finished: datetime | None
    counts: bool
    shown: bool
    summary: SummaryOut | None
    archive_sha256: str | None = None
    """Null for others than its team and admins, as are environment, evaluator, progress and queue."""
    archive_bytes: int | None = None
    environment: str | None = None
    evaluator: dict[str, Any] | None = None
    progress: dict[JobState, int] | None = None
    """Scenarios by state; null where they are hidden."""
    queue: QueueOut | None = None
    """Null when it is finished."""


class SubmissionsOut(ResponseModel):
    """The latest first."""

    items: list[SubmissionOut]
    next: str | None
    """For `before=`; null on the last page."""


class EgoOut(ResponseModel):
    """One CAV's outcome."""

    id: str
    outcome: str
    ds: float
    rc: float
    ip: float
    infractions: list[dict[str, Any]]


class ScenarioOut(ResponseModel):
    """One scenario and seed of a submission."""

    scenario: str
    seed: int
    state: JobState
    verdict: str | None
    reason: str | None
    bucket: str | None = None
    category: str | None = None
    ds: float | None = None
    sr: float | None = None
    rc: float | None = None
    ip: float | None = None
    egos: list[EgoOut] | None = None
    usage: dict[str, Any] | None = None
    recording: bool
    """Whether there is one to fetch."""
    logs: list[str]
    """CAVs of which there are logs; empty for others than its team and admins."""
    failure: str | None = None
    """What of ours went wrong; for admins."""


class ScenariosOut(ResponseModel):
    """By name and seed."""

    items: list[ScenarioOut]


class RowOut(ResponseModel):
    """One line of a leaderboard."""

    rank: int | None
    """Null where it is not comparable: driven by another evaluator, or published."""
    team: str
    method: str
    track: ChallengeTrack
    submission: str | None
    figures: FiguresOut
    created: datetime | None
    published: bool
    """From the MDrive paper, measured in CARLA: for comparison only."""


class LeaderboardOut(ResponseModel):
    """The best shown submission of each team; ties go to the earlier one. Published rows stand apart."""

    phase: str
    track: ChallengeTrack | None
    bucket: str | None
    category: str | None
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
    """The oldest first."""

    team: str
    phase: str
    items: list[PointOut]


class HealthOut(ResponseModel):
    """The server answers, and so does its database."""

    status: str
    version: str


class AuditOut(ResponseModel):
    """What a walk along the chain of the audit log found."""

    entries: int
    head: str
    broken: int | None
    """The first entry that does not fit to the one before."""
