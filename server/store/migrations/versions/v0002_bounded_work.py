"""Bounded work: overviews of jobs for lists, worker time of teams and submissions, refused uploads."""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
JSON = sa.JSON(none_as_null=True)
_SCORES = ("bucket", "category", "ds", "sr", "efficient_sr", "time_ratio", "rc", "ip")
_CHUNK = 100


def upgrade() -> None:
    """Add tables and a column, and write the overviews of finished jobs."""
    op.add_column("submissions", sa.Column("spent_us", sa.BigInteger(), nullable=False, server_default="0"))
    _worker_time()
    _refused_uploads()
    _overviews()
    _fill_overviews(op.get_bind())


def downgrade() -> None:
    """Drop them."""
    for table in ("job_overviews", "refused_uploads", "worker_time"):
        op.drop_table(table)
    op.drop_column("submissions", "spent_us")


def _worker_time() -> None:
    op.create_table(
        "worker_time",
        sa.Column("team", sa.String(32), nullable=False),
        sa.Column("phase", sa.String(40), nullable=False),
        sa.Column("used_us", sa.BigInteger(), nullable=False),
        sa.Column("at_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["team"], ["teams.id"]),
        sa.ForeignKeyConstraint(["phase"], ["phases.id"]),
        sa.PrimaryKeyConstraint("team", "phase"),
    )


def _refused_uploads() -> None:
    op.create_table(
        "refused_uploads",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("team", sa.String(32), nullable=False),
        sa.Column("at_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["team"], ["teams.id"]),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("refused_uploads_of_team", "refused_uploads", ["team", "at_us"])


def _overviews() -> None:
    op.create_table(
        "job_overviews",
        sa.Column("job", sa.Integer(), nullable=False),
        sa.Column("submission", sa.String(32), nullable=False),
        sa.Column("data", JSON, nullable=False),
        sa.ForeignKeyConstraint(["job"], ["jobs.id"]),
        sa.ForeignKeyConstraint(["submission"], ["submissions.id"]),
        sa.PrimaryKeyConstraint("job"),
    )
    op.create_index("job_overviews_of_submission", "job_overviews", ["submission"])


def _fill_overviews(connection: sa.Connection) -> None:
    jobs = sa.table("jobs", *(sa.column(name) for name in ("id", "submission")), sa.column("result", JSON))
    jobs.append_column(sa.column("usage", JSON))
    target = sa.table("job_overviews", sa.column("job"), sa.column("submission"), sa.column("data", JSON))
    ids = connection.scalars(sa.select(jobs.c.id).where(jobs.c.result.is_not(None)).order_by(jobs.c.id)).all()
    for start in range(0, len(ids), _CHUNK):
        rows = connection.execute(sa.select(jobs).where(jobs.c.id.in_(ids[start : start + _CHUNK]))).all()
        values = [{"job": row.id, "submission": row.submission, "data": _overview(row)} for row in rows]
        connection.execute(sa.insert(target), values)


def _overview(row: Any) -> dict[str, Any]:
    """Return what lists showed of a job's result until now, with at most 10 infractions of each CAV."""
    result: dict[str, Any] = row.result
    found: dict[str, Any] = {name: result.get(name) for name in _SCORES}
    egos = [_ego(ego) for ego in result["egos"]] if "egos" in result else None
    return found | {"egos": egos, "usage": row.usage}


def _ego(ego: dict[str, Any]) -> dict[str, Any]:
    fields = {name: ego.get(name) for name in ("id", "outcome", "ds", "rc", "ip", "ticks", "time_ratio")}
    listed = ego.get("infractions", [])
    return fields | {"infractions": listed[:10], "infractions_left_out": max(0, len(listed) - 10)}
