"""The first tables. What stands here is history: a change of `tables` is a new migration beside this one."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "1"
down_revision = None
JSON = sa.JSON(none_as_null=True)


def upgrade() -> None:
    """From an empty database; tables that others refer to come first."""
    _make_audit()
    _make_phases()
    _make_teams()
    _make_workers()
    _make_refused_uploads()
    _make_submissions()
    _make_tokens()
    _make_webhooks()
    _make_worker_time()
    _make_events()
    _make_jobs()
    _make_standings()
    _make_webhook_deliveries()
    _make_job_overviews()


def _column(
    name: str,
    kind: Any,
    refers_to: str | None = None,
    *,
    nullable: bool = False,
    primary_key: bool = False,
    unique: bool | None = None,
) -> sa.Column[Any]:
    """Return a column; `refers_to`: the table and column of a foreign key."""
    references = () if refers_to is None else (sa.ForeignKey(refers_to),)
    return sa.Column(name, kind, *references, nullable=nullable, primary_key=primary_key, unique=unique)


def _make_audit() -> None:
    op.create_table(
        "audit",
        _column("id", sa.Integer(), primary_key=True),
        _column("at_us", sa.BigInteger()),
        _column("actor", sa.String(80)),
        _column("action", sa.String(40)),
        _column("data", JSON),
        _column("hash", sa.String(64), unique=True),
    )


def _make_phases() -> None:
    op.create_table(
        "phases",
        _column("id", sa.String(40), primary_key=True),
        _column("title", sa.String(120)),
        _column("suite", sa.Text()),
        _column("public", sa.Boolean()),
        _column("opens_us", sa.BigInteger()),
        _column("closes_us", sa.BigInteger()),
        _column("per_day", sa.BigInteger()),
        _column("in_parallel", sa.BigInteger()),
        _column("in_total", sa.BigInteger()),
        _column("seeds", sa.BigInteger()),
        _column("sensor_track_only", sa.Boolean()),
        _column("cross_play_scenarios", sa.BigInteger()),
    )


def _make_teams() -> None:
    op.create_table(
        "teams",
        _column("id", sa.String(32), primary_key=True),
        _column("name", sa.String(64), unique=True),
        _column("created_us", sa.BigInteger()),
        _column("hidden", sa.Boolean()),
    )


def _make_workers() -> None:
    op.create_table(
        "workers",
        _column("owner", sa.String(80), primary_key=True),
        _column("host", sa.String(80)),
        _column("version", sa.String(40)),
        _column("scheduler", sa.String(120)),
        _column("started_us", sa.BigInteger()),
        _column("seen_us", sa.BigInteger()),
    )


def _make_refused_uploads() -> None:
    op.create_table(
        "refused_uploads",
        _column("id", sa.Integer(), primary_key=True),
        _column("team", sa.String(32), "teams.id"),
        _column("at_us", sa.BigInteger()),
    )
    op.create_index("refused_uploads_of_team", "refused_uploads", ["team", "at_us"])


def _make_submissions() -> None:
    op.create_table(
        "submissions",
        _column("id", sa.String(32), primary_key=True),
        _column("team", sa.String(32), "teams.id"),
        _column("phase", sa.String(40), "phases.id"),
        _column("track", sa.String(24)),
        _column("name", sa.String(80)),
        _column("archive_sha256", sa.String(64)),
        _column("archive_bytes", sa.BigInteger()),
        _column("environment", sa.String(40)),
        _column("idempotency_key", sa.String(80), nullable=True),
        _column("state", sa.String(16)),
        _column("why", sa.Text()),
        _column("created_us", sa.BigInteger()),
        _column("finished_us", sa.BigInteger(), nullable=True),
        _column("counts", sa.Boolean()),
        _column("shown", sa.Boolean()),
        _column("evaluator", JSON),
        _column("summary", JSON, nullable=True),
        _column("ds", sa.Double(), nullable=True),
        _column("spent_us", sa.BigInteger()),
        sa.UniqueConstraint("team", "idempotency_key"),
    )
    op.create_index("submissions_by_state", "submissions", ["state"])
    op.create_index(
        "submissions_of_team", "submissions", ["team", "phase", "created_us", "id", "state", "shown", "ds", "track"]
    )


def _make_tokens() -> None:
    op.create_table(
        "tokens",
        _column("id", sa.String(32), primary_key=True),
        _column("team", sa.String(32), "teams.id", nullable=True),
        _column("hash", sa.String(64), unique=True),
        _column("scope", sa.String(16)),
        _column("created_us", sa.BigInteger()),
        _column("revoked_us", sa.BigInteger(), nullable=True),
    )


def _make_webhooks() -> None:
    op.create_table(
        "webhooks",
        _column("team", sa.String(32), "teams.id", primary_key=True),
        _column("url", sa.Text()),
        _column("secret", sa.String(64)),
        _column("created_us", sa.BigInteger()),
    )


def _make_worker_time() -> None:
    op.create_table(
        "worker_time",
        _column("team", sa.String(32), "teams.id", primary_key=True),
        _column("phase", sa.String(40), "phases.id", primary_key=True),
        _column("used_us", sa.BigInteger()),
        _column("at_us", sa.BigInteger()),
    )


def _make_events() -> None:
    op.create_table(
        "events",
        _column("id", sa.Integer(), primary_key=True),
        _column("submission", sa.String(32), "submissions.id"),
        _column("at_us", sa.BigInteger()),
        _column("kind", sa.String(24)),
        _column("data", JSON),
    )
    op.create_index("events_of_submission", "events", ["submission", "id"])


def _make_jobs() -> None:
    op.create_table(
        "jobs",
        _column("id", sa.Integer(), primary_key=True),
        _column("kind", sa.String(16)),
        _column("submission", sa.String(32), "submissions.id"),
        _column("others", sa.String(32), "submissions.id"),
        _column("evaluator", sa.String(16)),
        _column("scenario", sa.String(120)),
        _column("seed", sa.BigInteger()),
        _column("state", sa.String(16)),
        _column("attempt", sa.BigInteger()),
        _column("failures", sa.BigInteger()),
        _column("owner", sa.String(80), nullable=True),
        _column("lease_us", sa.BigInteger(), nullable=True),
        _column("started_us", sa.BigInteger(), nullable=True),
        _column("finished_us", sa.BigInteger(), nullable=True),
        _column("verdict", sa.String(16), nullable=True),
        _column("reason", sa.String(16), nullable=True),
        _column("result", JSON, nullable=True),
        _column("usage", JSON, nullable=True),
        _column("failure", sa.Text()),
        sa.UniqueConstraint("kind", "submission", "others", "evaluator", "scenario", "seed"),
    )
    op.create_index("jobs_of_submission", "jobs", ["submission", "kind", "state"])
    op.create_index("jobs_to_claim", "jobs", ["state", "lease_us"])


def _make_standings() -> None:
    op.create_table(
        "standings",
        _column("phase", sa.String(40), "phases.id", primary_key=True),
        _column("slice", sa.String(80), primary_key=True),
        _column("track", sa.String(24), primary_key=True),
        _column("sensing_track", sa.String(8), primary_key=True),
        _column("team", sa.String(32), "teams.id", primary_key=True),
        _column("evaluator", sa.String(16), primary_key=True),
        _column("submission", sa.String(32), "submissions.id"),
        _column("method", sa.String(80)),
        _column("created_us", sa.BigInteger()),
        _column("ds", sa.Double()),
        _column("figures", JSON),
        sqlite_with_rowid=False,
    )


def _make_webhook_deliveries() -> None:
    op.create_table(
        "webhook_deliveries",
        _column("id", sa.String(32), primary_key=True),
        _column("submission", sa.String(32), "submissions.id"),
        _column("team", sa.String(32), "teams.id"),
        _column("state", sa.String(16)),
        _column("attempts", sa.BigInteger()),
        _column("next_us", sa.BigInteger()),
        _column("created_us", sa.BigInteger()),
        _column("problem", sa.Text()),
    )
    op.create_index("webhook_deliveries_due", "webhook_deliveries", ["state", "next_us"])
    op.create_index("webhook_deliveries_of_team", "webhook_deliveries", ["team", "created_us"])


def _make_job_overviews() -> None:
    op.create_table(
        "job_overviews",
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.id"), primary_key=True, autoincrement=False),
        _column("submission", sa.String(32), "submissions.id"),
        _column("data", JSON),
    )
    op.create_index("job_overviews_of_submission", "job_overviews", ["submission"])
