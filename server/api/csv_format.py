"""CSV of results and leaderboards. Cells that a spreadsheet would evaluate as formulas become text."""

import csv
import io
from collections.abc import Iterable, Sequence

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def to_csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the table as CSV (RFC 4180); None becomes an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerows([_escape_formula(cell) for cell in row] for row in (header, *rows))
    return text.getvalue()


def csv_headers(name: str) -> dict[str, str]:
    """Return the headers of an answer that browsers save as `name`.csv."""
    return {"Content-Disposition": f'attachment; filename="{name}.csv"'}


def _escape_formula(cell: object) -> object:
    """Return the cell so that spreadsheets do not evaluate it: names are text of participants."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA_STARTS) else cell
