"""Response bodies of phases and submissions."""

from datetime import datetime
from typing import Any

from mdrive_sumo.contract import SensingTrack
from server.api.schemas.parameters import Reason, RequestModel, ResponseModel
from server.enums import ChallengeTrack, JobState, SubmissionState


class ReasonIn(RequestModel):
    """Shown to everyone who may see the submission."""

    reason: Reason


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
    """Beside the score: `mean_speed` [m/s], `comfort` [%], `min_pet` [s], `message_rate` [bytes/s], `speeding` [%],
    means over the scenarios in which each is defined, and `min_ttc` [s], the least of all scenarios. Null in older
    results."""


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
