"""The tables. The database holds all state; every other part of the server may be killed at any time.

Times are integers, microseconds since 1970 in UTC: they compare the same way in SQLite and PostgreSQL.
"""

from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    ColumnElement,
    ForeignKey,
    Index,
    Integer,
    String,
    Text,
    UniqueConstraint,
    and_,
)
from sqlalchemy.orm import DeclarativeBase, InstrumentedAttribute, Mapped, mapped_column

from server.enums import JobKind

Id = String(32)
"""Random ids of 128 bits in hexadecimal, which cannot be counted or guessed."""


class TableBase(DeclarativeBase):
    """Base class of all tables."""

    type_annotation_map = {dict[str, Any]: JSON(none_as_null=True), int: BigInteger}  # noqa: RUF012 (SQLAlchemy's own interface)


class TeamRow(TableBase):
    """A participating team."""

    __tablename__ = "teams"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(String(64), unique=True)
    created_us: Mapped[int]
    hidden: Mapped[bool] = mapped_column(default=False)
    """Whether it is left out of leaderboards."""


class TokenRow(TableBase):
    """A token that authenticates a client; only its hash is stored."""

    __tablename__ = "tokens"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    team: Mapped[str | None] = mapped_column(ForeignKey("teams.id"))
    """Team whose actions the token permits; None for admins and workers."""
    hash: Mapped[str] = mapped_column(String(64), unique=True)
    """SHA-256 of the token's text, which has 256 random bits."""
    scope: Mapped[str] = mapped_column(String(16))
    created_us: Mapped[int]
    revoked_us: Mapped[int | None]


class PhaseRow(TableBase):
    """A period in which submissions are accepted, on one suite."""

    __tablename__ = "phases"
    id: Mapped[str] = mapped_column(String(40), primary_key=True)
    """Short name, as users type it: `warm-up`."""
    title: Mapped[str] = mapped_column(String(120))
    suite: Mapped[str] = mapped_column(Text)
    """A packaged suite's name, without a season season 0, or a folder on the server."""
    public: Mapped[bool]
    """False: the server discloses aggregates only."""
    opens_us: Mapped[int]
    closes_us: Mapped[int]
    per_day: Mapped[int]
    in_parallel: Mapped[int]
    in_total: Mapped[int]
    seeds: Mapped[int] = mapped_column(default=1)
    """Seeds 0 .. n-1 of every scenario."""
    sensor_track_only: Mapped[bool] = mapped_column(default=False)
    """Whether agents that are given lists of objects are rejected."""
    cross_play_scenarios: Mapped[int] = mapped_column(default=0)
    """Scenarios of each pair of agents on the board of cross-play; 0: there is none."""


class SubmissionRow(TableBase):
    """One archive in one phase."""

    __tablename__ = "submissions"
    __table_args__ = (
        UniqueConstraint("team", "idempotency_key"),
        # Covers a team's score history, so that none of the long rows is read for it.
        Index("submissions_of_team", "team", "phase", "created_us", "id", "state", "shown", "ds", "track"),
        Index("submissions_by_state", "state"),
    )
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"))
    phase: Mapped[str] = mapped_column(ForeignKey("phases.id"))
    track: Mapped[str] = mapped_column(String(24))
    name: Mapped[str] = mapped_column(String(80))
    """Name of the method, as its team chose it."""
    archive_sha256: Mapped[str] = mapped_column(String(64))
    archive_bytes: Mapped[int]
    environment: Mapped[str] = mapped_column(String(40))
    idempotency_key: Mapped[str | None] = mapped_column(String(80))
    state: Mapped[str] = mapped_column(String(16))
    why: Mapped[str] = mapped_column(Text, default="")
    """Reason in one sentence if it was rejected, disqualified or failed."""
    created_us: Mapped[int]
    finished_us: Mapped[int | None]
    counts: Mapped[bool] = mapped_column(default=True)
    """Whether it counts against the quota."""
    shown: Mapped[bool] = mapped_column(default=True)
    """Whether it may be on the leaderboard."""
    evaluator: Mapped[dict[str, Any]]
    """Version, code and suite checksums, sandbox settings, packages of the environment; see `scores.digest`."""
    summary: Mapped[dict[str, Any] | None]
    """A `standings.SummaryData`; written once, when the submission is done."""
    ds: Mapped[float | None]
    """Overall DS as in `summary`: leaderboards sort by it."""
    spent_us: Mapped[int] = mapped_column(default=0)
    """Worker time of its finished jobs [us]: counts towards its budget."""


class JobRow(TableBase):
    """One scenario and seed to drive, of any `JobKind`: claimed under a lease, finished once."""

    __tablename__ = "jobs"
    __table_args__ = (
        UniqueConstraint("kind", "submission", "others", "evaluator", "scenario", "seed"),
        Index("jobs_to_claim", "state", "lease_us"),
        Index("jobs_of_submission", "submission", "kind", "state"),
    )
    id: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=True)
    kind: Mapped[str] = mapped_column(String(16), default=JobKind.SUBMISSION.value)
    submission: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    """The submission under test."""
    others: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    """The submission that drives the other CAVs: the same one, but in cross-play."""
    evaluator: Mapped[str] = mapped_column(String(16), default="")
    """In cross-play the digest of `SubmissionRow.evaluator`: another evaluator drives the pair again. Else ""."""
    scenario: Mapped[str] = mapped_column(String(120))
    seed: Mapped[int]
    state: Mapped[str] = mapped_column(String(16))
    attempt: Mapped[int] = mapped_column(default=0)
    """How often it was claimed; together with `owner` it identifies the claim, so it never decreases."""
    failures: Mapped[int] = mapped_column(default=0)
    """Attempts that failed on our side, see `store.jobs.MAX_FAILURES`. A graceful shutdown does not count."""
    owner: Mapped[str | None] = mapped_column(String(80))
    lease_us: Mapped[int | None]
    """Time until which `owner` holds the job [us since 1970]; None if nothing holds it."""
    started_us: Mapped[int | None]
    finished_us: Mapped[int | None]
    verdict: Mapped[str | None] = mapped_column(String(16))
    reason: Mapped[str | None] = mapped_column(String(16))
    result: Mapped[dict[str, Any] | None]
    """`mdrive_sumo.scoring.ScenarioResult`; in cross-play a `store.cross_play.CrossPlayScore`; none of spot checks."""
    usage: Mapped[dict[str, Any] | None]
    """Usage of the sandboxes: CPU time, memory, latency histogram, exit, layers."""
    failure: Mapped[str] = mapped_column(Text, default="")
    """Failure on our side in the last attempt; for admins only."""

    @classmethod
    def is_of(cls, submission: str | InstrumentedAttribute[str]) -> ColumnElement[bool]:
        """Return the condition of the jobs that make a submission's score, one for each scenario and seed."""
        return and_(cls.kind == JobKind.SUBMISSION, cls.submission == submission)


class JobOverviewRow(TableBase):
    """What lists show of a finished job. Its size is bounded, and reading it reads no part of `JobRow.result`."""

    __tablename__ = "job_overviews"
    __table_args__ = (Index("job_overviews_of_submission", "submission"),)
    job: Mapped[int] = mapped_column(Integer, ForeignKey("jobs.id"), primary_key=True, autoincrement=False)
    submission: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    data: Mapped[dict[str, Any]]
    """Scores, outcome of each CAV, and `JobRow.usage`; see `store.overviews`."""


class WorkerTimeRow(TableBase):
    """Recent worker time of a team in a phase: the queue gives the next job to the team with the least."""

    __tablename__ = "worker_time"
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"), primary_key=True)
    phase: Mapped[str] = mapped_column(ForeignKey("phases.id"), primary_key=True)
    used_us: Mapped[int]
    """Worker time as of `at_us`, halved every `store.worker_time.HALF_LIFE_US`."""
    at_us: Mapped[int]


class RefusedUploadRow(TableBase):
    """An upload whose archive was examined and refused: a team has a daily quota of these."""

    __tablename__ = "refused_uploads"
    __table_args__ = (Index("refused_uploads_of_team", "team", "at_us"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=True)
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"))
    at_us: Mapped[int]


class WorkerRow(TableBase):
    """A process that claims jobs, with its last heartbeat; one that ends in good order deletes its row."""

    __tablename__ = "workers"
    owner: Mapped[str] = mapped_column(String(80), primary_key=True)
    """Name of the process, as in `JobRow.owner`: no other process has or had it."""
    host: Mapped[str] = mapped_column(String(80))
    version: Mapped[str] = mapped_column(String(40))
    scheduler: Mapped[str] = mapped_column(String(120))
    """Scheduler of the Dask cluster that executes its jobs; "" if it executes them itself."""
    started_us: Mapped[int]
    seen_us: Mapped[int]


class StandingRow(TableBase):
    """The best result of a team: one line of one leaderboard, stored so that reading a board is cheap."""

    __tablename__ = "standings"
    # SQLite then stores the rows in the order of the key, so that those of one board are adjacent.
    __table_args__ = ({"sqlite_with_rowid": False},)
    phase: Mapped[str] = mapped_column(ForeignKey("phases.id"), primary_key=True)
    slice: Mapped[str] = mapped_column(String(80), primary_key=True)
    """overall, bucket:NAME or category:NAME."""
    track: Mapped[str] = mapped_column(String(24), primary_key=True)
    sensing_track: Mapped[str] = mapped_column(String(8), primary_key=True)
    """sensor or object, as the results say: a team's best of each has a line of its own."""
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"), primary_key=True)
    evaluator: Mapped[str] = mapped_column(String(16), primary_key=True)
    """Digest of `SubmissionRow.evaluator`."""
    submission: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    method: Mapped[str] = mapped_column(String(80))
    """`SubmissionRow.name`, copied so that a board reads none of the long rows of submissions."""
    created_us: Mapped[int]
    """Time of the submission: ties go to the earlier one."""
    ds: Mapped[float]
    figures: Mapped[dict[str, Any]]
    """This slice's part of `SubmissionRow.summary`."""


class WebhookRow(TableBase):
    """Where a team is notified of its finished submissions."""

    __tablename__ = "webhooks"
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"), primary_key=True)
    url: Mapped[str] = mapped_column(Text)
    secret: Mapped[str] = mapped_column(String(64))
    """Key of the signatures, `whsec_` and base64 as in Standard Webhooks; signing needs its text, not a hash."""
    created_us: Mapped[int]


class WebhookDeliveryRow(TableBase):
    """One notification: written with the end of its submission, delivered later by `server.api.webhook_sender`."""

    __tablename__ = "webhook_deliveries"
    __table_args__ = (
        Index("webhook_deliveries_due", "state", "next_us"),
        Index("webhook_deliveries_of_team", "team", "created_us"),
    )
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    submission: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    team: Mapped[str] = mapped_column(ForeignKey("teams.id"))
    state: Mapped[str] = mapped_column(String(16))
    attempts: Mapped[int] = mapped_column(default=0)
    """How often it was begun, so that a crash while sending counts."""
    next_us: Mapped[int]
    """Time of the next attempt [us since 1970]."""
    created_us: Mapped[int]
    problem: Mapped[str] = mapped_column(Text, default="")
    """Why the last attempt failed, in one sentence; "" if none did."""


class EventRow(TableBase):
    """An event of a submission; server-sent events replay them from any id on."""

    __tablename__ = "events"
    __table_args__ = (Index("events_of_submission", "submission", "id"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=True)
    submission: Mapped[str] = mapped_column(ForeignKey("submissions.id"))
    at_us: Mapped[int]
    kind: Mapped[str] = mapped_column(String(24))
    data: Mapped[dict[str, Any]]


class AuditEntryRow(TableBase):
    """Entry of the append-only audit log; its hash covers the hash of the entry before."""

    __tablename__ = "audit"
    id: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=True)
    at_us: Mapped[int]
    actor: Mapped[str] = mapped_column(String(80))
    action: Mapped[str] = mapped_column(String(40))
    data: Mapped[dict[str, Any]]
    hash: Mapped[str] = mapped_column(String(64), unique=True)
