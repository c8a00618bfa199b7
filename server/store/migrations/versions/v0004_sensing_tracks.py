"""Sensing tracks: leaderboards keep them apart, and a phase can be for the sensor track only."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
JSON = sa.JSON(none_as_null=True)
_COLUMNS = ("phase", "slice", "track", "team", "evaluator", "submission", "method", "created_us", "ds", "figures")


def upgrade() -> None:
    """Add the track to standings, where it belongs to the key, and an option to phases.

    Results from before tracks existed count as object track: nothing says what their agents declared.
    """
    op.add_column("phases", sa.Column("sensor_track_only", sa.Boolean(), nullable=False, server_default=sa.false()))
    _replace_standings("sensing_track", "'object'")


def downgrade() -> None:
    """Remove them; of a team's two rows of one board that of the object track is kept."""
    op.drop_column("phases", "sensor_track_only")
    op.execute("DELETE FROM standings WHERE sensing_track = 'sensor'")
    _replace_standings("", "")


def _replace_standings(column: str, value: str) -> None:
    """Make the table again with or without the column: SQLite cannot change a primary key."""
    op.rename_table("standings", "old_standings")
    key = ["phase", "slice", "track", "team", "evaluator"]
    added = [sa.Column(column, sa.String(8), nullable=False)] if column else []
    op.create_table(
        "standings",
        sa.Column("phase", sa.String(40), nullable=False),
        sa.Column("slice", sa.String(80), nullable=False),
        sa.Column("track", sa.String(24), nullable=False),
        *added,
        sa.Column("team", sa.String(32), nullable=False),
        sa.Column("evaluator", sa.String(16), nullable=False),
        sa.Column("submission", sa.String(32), nullable=False),
        sa.Column("method", sa.String(80), nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.Column("ds", sa.Double(), nullable=False),
        sa.Column("figures", JSON, nullable=False),
        sa.ForeignKeyConstraint(["phase"], ["phases.id"]),
        sa.ForeignKeyConstraint(["submission"], ["submissions.id"]),
        sa.ForeignKeyConstraint(["team"], ["teams.id"]),
        sa.PrimaryKeyConstraint(*key[:3], *([column] if column else []), *key[3:]),
        sqlite_with_rowid=False,
    )
    names = ", ".join(_COLUMNS)
    more = (f", {column}", f", {value}") if column else ("", "")
    op.execute(f"INSERT INTO standings ({names}{more[0]}) SELECT {names}{more[1]} FROM old_standings")
    op.drop_table("old_standings")
