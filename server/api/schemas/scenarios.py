"""Response bodies of scenarios: of one submission, of two compared, of many in a matrix."""

from typing import Any

from server.api.schemas.parameters import ResponseModel
from server.api.schemas.submissions import SubmissionOut
from server.enums import ChallengeTrack, JobState


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
    place: str | None = None
    """The network; null in results from before it was kept."""
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
    place: str | None
    """The network, if either submission knows it."""
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
    ds_low: float | None
    ds_high: float | None
    """95 % bootstrap interval of `ds`: places, their scenarios and seeds are resampled. None for too few places."""
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
