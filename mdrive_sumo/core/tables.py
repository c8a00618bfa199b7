"""Tables as plain text, Markdown and CSV. Only `core` is needed, so `doctor` works on a broken installation."""

import csv
import io
import re
from collections.abc import Iterable, Sequence

from mdrive_sumo.core.clean_text import clean_for_csv, clean_for_markdown, clean_line

TableRow = Sequence[str]

NUMBER = re.compile(r"[-+]?[\d.]*")


def format_text_table(header: TableRow, rows: Iterable[TableRow]) -> str:
    """Return an aligned table for the terminal; columns of numbers are right-aligned, all others left-aligned."""
    lines_of_cells = [[clean_line(cell) for cell in row] for row in (header, *rows)]
    columns = [_align(column) for column in zip(*lines_of_cells, strict=True)]
    lines = ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]
    return "\n".join((lines[0], "-" * max(map(len, lines)), *lines[1:]))


def format_markdown_table(header: TableRow, rows: Iterable[TableRow], left: int = 1) -> str:
    """Return a Markdown table; the first `left` columns are left-aligned, the others right-aligned."""
    rule = ["---" if i < left else "---:" for i in range(len(header))]
    head, *body = [[clean_for_markdown(cell) for cell in row] for row in (header, *rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *body))


def format_csv_table(header: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return a CSV table (RFC 4180, but with line feeds)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows(map(clean_csv_row, (header, *rows)))
    return text.getvalue()


def clean_csv_row(row: Iterable[object]) -> list[object]:
    """Return the cells of a CSV table, of which no text is a formula; numbers stay numbers."""
    return [clean_for_csv(cell) if isinstance(cell, str) else cell for cell in row]


def _align(column: TableRow) -> list[str]:
    width = max(map(len, column))
    if all(map(NUMBER.fullmatch, column[1:])):
        return [cell.rjust(width) for cell in column]
    return [cell.ljust(width) for cell in column]
