"""Cross-play: an option of phases, and the jobs in which one CAV of an agent drives among CAVs of another."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
JSON = sa.JSON(none_as_null=True)


def upgrade() -> None:
    """Add the option and the table."""
    column = sa.Column("cross_play_scenarios", sa.BigInteger(), nullable=False, server_default="0")
    op.add_column("phases", column)
    op.create_table(
        "cross_play_jobs",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("phase", sa.String(40), nullable=False),
        sa.Column("evaluator", sa.String(16), nullable=False),
        sa.Column("tested", sa.String(32), nullable=False),
        sa.Column("others", sa.String(32), nullable=False),
        sa.Column("scenario", sa.String(120), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("attempt", sa.BigInteger(), nullable=False),
        sa.Column("failures", sa.BigInteger(), nullable=False),
        sa.Column("owner", sa.String(80), nullable=True),
        sa.Column("lease_us", sa.BigInteger(), nullable=True),
        sa.Column("finished_us", sa.BigInteger(), nullable=True),
        sa.Column("result", JSON, nullable=True),
        sa.Column("failure", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["phase"], ["phases.id"]),
        sa.ForeignKeyConstraint(["tested"], ["submissions.id"]),
        sa.ForeignKeyConstraint(["others"], ["submissions.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("phase", "evaluator", "tested", "others", "scenario"),
    )
    op.create_index("cross_play_jobs_to_claim", "cross_play_jobs", ["state", "lease_us"])


def downgrade() -> None:
    """Remove them."""
    op.drop_table("cross_play_jobs")
    op.drop_column("phases", "cross_play_scenarios")
