"""Request and response bodies of the API. Times are ISO 8601 in UTC.

The OpenAPI description uses the class names without the suffixes `In` and `Out`.
"""

from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mdrive_sumo.contract import SensingTrack
from server.enums import ChallengeTrack, DeliveryState, JobState, SubmissionState, TokenScope


def to_datetime(at_us: int) -> datetime:
    """Convert microseconds since 1970 to a UTC datetime."""
    return datetime.fromtimestamp(at_us / 1e6, UTC)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("printable characters")
    return text


TeamName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable)]
"""Name of a team, or its id."""
ID_PATTERN, PHASE_PATTERN = r"^[0-9a-f]{32}$", r"^[a-z0-9][a-z0-9-]{0,39}$"
SCENARIO_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}$"
"""Every pattern has its words in `problems`, which people read instead of it."""
Id = Annotated[str, Field(pattern=ID_PATTERN)]
PhaseId = Annotated[str, Field(pattern=PHASE_PATTERN)]
ScenarioId = Annotated[str, Field(pattern=SCENARIO_PATTERN)]
"""Id of a scenario as in its file, or of a CAV."""
SearchText = Annotated[str, Field(min_length=2, max_length=80), AfterValidator(_printable)]
"""Part of a name, or an id."""
Seed = Annotated[int, Field(ge=0, le=1_000_000)]
PartName = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_printable)]
"""A bucket or a category."""


class RequestModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class ResponseModel(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class NewTeamIn(RequestModel):
    """A team to create."""

    name: TeamName


class HideIn(RequestModel):
    """Whether a team is hidden from leaderboards."""

    hidden: bool


class NewTokenIn(RequestModel):
    """The scope `submit` needs a team, `admin` and `worker` have none."""

    scope: TokenScope = TokenScope.SUBMIT
    team: TeamName | None = None


class ShowIn(RequestModel):
    """Whether a submission may be on the leaderboard."""

    shown: bool


class ReasonIn(RequestModel):
    """Shown to everyone who may see the submission."""

    reason: Annotated[str, Field(min_length=1, max_length=500), AfterValidator(_printable)]


class NewWebhookIn(RequestModel):
    """A team's webhook."""

    url: Annotated[str, Field(min_length=1, max_length=500)]


class DeliveryOut(ResponseModel):
    """A notification by webhook."""

    id: str
    """The header `webhook-id`."""
    submission: str
    state: DeliveryState
    attempts: int
    problem: str
    """Why the last attempt failed, if it did."""


class WebhookOut(ResponseModel):
    """A team's webhook without its secret."""

    enabled: bool
    """Whether this server sends notifications."""
    url: str | None
    created: datetime | None
    deliveries: list[DeliveryOut]
    """The latest ones, the newest first."""


class WebhookSecretOut(ResponseModel):
    """A new webhook; its secret is shown this once."""

    url: str
    secret: str


class TeamOut(ResponseModel):
    """A participating team."""

    id: str
    name: str
    created: datetime
    hidden: bool


class TeamsOut(ResponseModel):
    """All teams."""

    items: list[TeamOut]


class TokenOut(ResponseModel):
    """A token without its text, which is not stored."""

    id: str
    team: str | None
    scope: TokenScope
    created: datetime
    revoked: datetime | None


class TokensOut(ResponseModel):
    """Tokens, the oldest first."""

    items: list[TokenOut]


class IssuedTokenOut(ResponseModel):
    """A new token; its text is shown this once."""

    token: str


class RegisteredOut(ResponseModel):
    """A registered team and its token, which is shown this once."""

    team: TeamOut
    token: str


class MeOut(ResponseModel):
    """The holder of the token."""

    scope: TokenScope
    team: TeamOut | None


class PhaseOut(ResponseModel):
    """When submissions are accepted, on which suite, and how many per team."""

    id: str
    title: str
    suite: str | None
    """Name of the suite; null if it is hidden."""
    public: bool
    open: bool
    opens: datetime
    closes: datetime
    per_day: int
    in_parallel: int
    in_total: int
    seeds: int
    sensor_track_only: bool
    """Whether agents that are given lists of objects are rejected."""
    cross_play_scenarios: int
    """Scenarios of each pair on the board of cross-play; 0: there is none."""


class PhasesOut(ResponseModel):
    """Phases in the order in which they open."""

    items: list[PhaseOut]


class QuotaOut(ResponseModel):
    """What a team has used of a phase's quota."""

    today: int
    in_parallel: int
    in_total: int


class FiguresOut(ResponseModel):
    """Means of a submission over all its scenarios, one bucket or one category. DS, SR and RC in percent.

    Of a hidden phase only the overall DS (to 0.1), SR (to 1 %) and the number of scenarios; all others are null.
    """

    ds: float
    sr: float | None = None
    rc: float | None = None
    ip: float | None = None
    ds_low: float | None = None
    ds_high: float | None = None
    sr_low: float | None = None
    sr_high: float | None = None
    efficient_sr: float | None = None
    """Success rate that counts only successes within twice `omniscient`'s time; null without reference times."""
    time_ratio: float | None = None
    """Time needed divided by `omniscient`'s, over the `timed` scenarios."""
    timed: int | None = None
    """Number of scenarios in which every CAV arrived with a seed or more."""
    scenarios: int | None = None
    infractions: dict[str, int] | None = None
    scalars: dict[str, float | None] | None = None
    """Beside the score: `mean_speed` [m/s], `comfort` [%], `min_pet` [s], `message_rate` [bytes/s], means over the
    scenarios in which each is defined, and `min_ttc` [s], the least of all scenarios. Null in older results."""


class SummaryOut(ResponseModel):
    """The result of a submission; in a hidden phase without buckets and categories."""

    overall: FiguresOut
    buckets: dict[str, FiguresOut]
    categories: dict[str, FiguresOut]


class QueueOut(ResponseModel):
    """Position of an unfinished submission in the queue."""

    position: int
    """1: it is the next."""
    eta_s: int | None
    """Estimated time to the result, in whole minutes; null if unknown or if it would disclose hidden scenarios."""


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
    """Reason in one sentence if it was rejected, disqualified or failed."""
    created: datetime
    finished: datetime | None
    """In a hidden phase the beginning of the hour, except for admins."""
    sensing_track: SensingTrack | None
    """Whether its agent was given lists of objects; null until it is done, and in older results."""
    counts: bool
    shown: bool
    summary: SummaryOut | None
    archive_sha256: str | None = None
    """Null except for its team and admins, as are environment, evaluator, progress and queue."""
    archive_bytes: int | None = None
    environment: str | None = None
    evaluator: dict[str, Any] | None = None
    progress: dict[JobState, int] | None = None
    """Number of scenarios by state; null if they are hidden."""
    queue: QueueOut | None = None
    """Null when it is finished."""


class SubmissionsOut(ResponseModel):
    """Submissions, the latest first."""

    items: list[SubmissionOut]
    next: str | None
    """Value of `before` for the next page; null on the last one."""


class EgoOut(ResponseModel):
    """One CAV's outcome."""

    id: str
    outcome: str
    ds: float
    rc: float
    ip: float
    ticks: int | None = None
    """Ticks (1/20 s) from the start to its end."""
    time_ratio: float | None = None
    """Its time divided by `omniscient`'s; null unless it arrived."""
    infractions: list[dict[str, Any]]
    """The first 10 of them."""
    infractions_left_out: int = 0
    """How many more there are."""


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
    efficient_sr: float | None = None
    time_ratio: float | None = None
    rc: float | None = None
    ip: float | None = None
    egos: list[EgoOut] | None = None
    usage: dict[str, Any] | None = None
    recording: bool
    """Whether a recording can be fetched."""
    logs: list[str]
    """CAVs that have logs; empty except for its team and admins."""
    failure: str | None = None
    """Failure of the evaluation itself; for admins."""


class ScenariosOut(ResponseModel):
    """Scenarios by name and seed."""

    items: list[ScenarioOut]


class ScenarioPairOut(ResponseModel):
    """One scenario and seed in two submissions, A and B."""

    scenario: str
    seed: int
    bucket: str | None
    category: str | None
    verdict_a: str | None
    verdict_b: str | None
    ds_a: float
    ds_b: float
    ds_difference: float
    """DS of B minus that of A: positive means that B is better."""


class PairedDifferenceOut(ResponseModel):
    """DS of B minus that of A over the scenarios that both have."""

    scenarios: int
    """Each counts once, with the mean over its seeds."""
    ds: float
    ds_low: float
    ds_high: float
    """95 % bootstrap interval of `ds`: the scenarios are resampled."""
    better: int
    """Scenarios in which B has at least 0.005 more."""
    equal: int
    worse: int


class ComparisonOut(ResponseModel):
    """Two submissions of one phase. In a hidden phase without scenarios, except for admins."""

    a: SubmissionOut
    b: SubmissionOut
    same_evaluator: bool
    """False: another version, suite or sandbox, so that the results cannot be compared."""
    paired: PairedDifferenceOut | None
    """Null if the scenarios are hidden or the two have none in common."""
    scenarios: list[ScenarioPairOut] | None
    """Those that both have, the largest losses of B first; null if they are hidden."""


class MatrixColumnOut(ResponseModel):
    """A team of the matrix with its best shown submission."""

    team: str
    submission: str
    method: str
    track: ChallengeTrack
    rank: int | None
    ds: float


class MatrixCellOut(ResponseModel):
    """One team in one scenario."""

    ds: float
    """Mean over the seeds."""
    failed: int
    """Seeds in which an agent failed."""


class MatrixRowOut(ResponseModel):
    """One scenario."""

    scenario: str
    bucket: str | None
    category: str | None
    ds: float
    """Mean of the teams that have a result."""
    failed: int
    """Teams of which an agent failed with a seed or more."""
    cells: list[MatrixCellOut | None]
    """In the order of the columns; null without a result."""


class MatrixOut(ResponseModel):
    """DS of teams (columns, by rank) in each scenario (rows, by name); for admins."""

    phase: str
    track: ChallengeTrack | None
    page: int
    pages: int
    columns: list[MatrixColumnOut]
    rows: list[MatrixRowOut]


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


class HealthOut(ResponseModel):
    """The server and its database answer."""

    status: str
    version: str


class AuditOut(ResponseModel):
    """Result of verifying the audit log's hash chain."""

    entries: int
    head: str
    broken: int | None
    """Id of the first entry whose hash does not fit the one before; null if all fit."""
    differences: list[str] = []
    """Rows that are not as the log says, at most 100; empty if the chain is broken."""
