"""BoardView: which leaderboard is shown, in which order, with which columns; and its CSV."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlencode

from server.api.csv_format import to_csv
from server.api.leaderboards import BoardKey
from server.api.schemas.leaderboards import LeaderboardOut
from server.api.schemas.submissions import FiguresOut


@dataclass(frozen=True, slots=True)
class ScalarColumn:
    """One scalar metric on boards and on pages of submissions."""

    name: str
    """Key in `FiguresOut.scalars`, and of the sort order."""
    title: str
    """Header of the column, with its unit."""
    decimals: int
    is_falling: bool
    """Whether sorting begins with the largest value."""

    def format_value(self, figures: FiguresOut) -> str:
        """Return the value as text; a dash where it is undefined or not disclosed."""
        value = self.find_value(figures)
        return "–" if value is None else f"{value:.{self.decimals}f}"

    def find_value(self, figures: FiguresOut) -> float | None:
        """Return the value; None where it is undefined or not disclosed."""
        return (figures.scalars or {}).get(self.name)


SCALAR_COLUMNS = (
    ScalarColumn("mean_speed", "Speed m/s", 2, True),
    ScalarColumn("comfort", "Comfort %", 1, True),
    ScalarColumn("min_ttc", "Least TTC s", 2, True),
    ScalarColumn("min_pet", "PET s", 1, True),
    ScalarColumn("message_rate", "Messages B/s", 0, False),
    ScalarColumn("speeding", "Speeding %", 1, False),
)
"""In the order of the columns."""


SCALAR_BY_NAME = {column.name: column for column in SCALAR_COLUMNS}
SORTS: Mapping[str, bool] = {
    "rank": False,
    "team": False,
    "method": False,
    "ds": True,
    "sr": True,
    "efficient_sr": True,
    "time_ratio": False,
    "rc": True,
    "ip": True,
    "date": True,
    **{column.name: column.is_falling for column in SCALAR_COLUMNS},
}
"""Columns by which a board can be sorted, and whether the largest value comes first."""
COLUMNS_BESIDE = "beside"
"""Value of `columns` that shows the scalar metrics."""


@dataclass(frozen=True, slots=True)
class BoardView:
    """A board with sort order and page number."""

    key: BoardKey
    sort: str = "rank"
    is_reversed: bool = False
    """Whether the usual order is reversed."""
    page: int = 1
    columns: str = ""
    """"": the scores; `COLUMNS_BESIDE`: the scalar metrics beside DS and SR."""

    def query(self, **changed: Any) -> str:
        """Return the query string of this view, with some fields changed."""
        view = replace(self, **changed)
        of_page = {"sort": view.sort if view.sort != "rank" else "", "turned": "1" if view.is_reversed else ""}
        of_page["page"] = str(view.page) if view.page > 1 else ""
        of_page["columns"] = view.columns
        return urlencode(dict(self.filters()) | {name: value for name, value in of_page.items() if value})

    def filters(self) -> list[tuple[str, str]]:
        """Return the query parameters that select the board, as in the API."""
        key = self.key
        given = {
            "phase": key.phase,
            "track": key.track,
            "sensing_track": key.sensing_track,
            "bucket": key.bucket,
            "category": key.category,
        }
        return [(name, str(value)) for name, value in given.items() if value]


def format_csv(board: LeaderboardOut) -> str:
    figures = (
        *("ds", "ds_low", "ds_high", "sr", "sr_low", "sr_high"),
        *("efficient_sr", "time_ratio", "timed", "rc", "ip", "scenarios"),
    )
    return to_csv(
        (
            "rank",
            "team",
            "method",
            "track",
            "sensing_track",
            *figures,
            *SCALAR_BY_NAME,
            "created",
            "submission",
            "published",
        ),
        (
            (
                *(row.rank, row.team, row.method, row.track.value, row.sensing_track),
                *(getattr(row.figures, name) for name in figures),
                *(column.find_value(row.figures) for column in SCALAR_COLUMNS),
                *(row.created.isoformat() if row.created else None, row.submission, row.published),
            )
            for row in (*board.rows, *board.published)
        ),
    )
