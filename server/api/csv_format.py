"""CSV of results and leaderboards. Cells that a spreadsheet would evaluate as formulas become text."""

import csv
import io
from collections.abc import Iterable, Sequence

from mdrive_sumo.core.tables import clean_csv_row


def to_csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the table as CSV (RFC 4180); None becomes an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerows(clean_csv_row(row) for row in (header, *rows))
    return text.getvalue()


def csv_headers(name: str) -> dict[str, str]:
    """Return the headers of an answer that browsers save as `name`.csv."""
    return {"Content-Disposition": f'attachment; filename="{name}.csv"'}
