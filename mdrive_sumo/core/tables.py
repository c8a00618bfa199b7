"""Tables as plain text, Markdown and CSV. Needs nothing else, so `doctor` can use it on a broken installation."""

import csv
import io
import re
from collections.abc import Iterable, Sequence

TableRow = Sequence[str]

NUMBER = re.compile(r"[-+]?[\d.]*")


def format_text_table(header: TableRow, rows: Iterable[TableRow]) -> str:
    """Return an aligned table for the terminal; columns of numbers are right-aligned, all others left-aligned."""
    body = [tuple(row) for row in rows]
    columns = [_align(column) for column in zip(tuple(header), *body, strict=True)]
    lines = ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]
    return "\n".join((lines[0], "-" * max(map(len, lines)), *lines[1:]))


def format_markdown_table(header: TableRow, rows: Iterable[TableRow], left: int = 1) -> str:
    """Return a Markdown table; the first `left` columns are left-aligned, the others right-aligned."""
    rule = ["---" if i < left else "---:" for i in range(len(header))]
    body = [[escape_markdown(cell) for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in (header, rule, *body))


def format_csv_table(header: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return a CSV table (RFC 4180, but with line feeds)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def escape_markdown(text: str) -> str:
    """Return text that can neither break a Markdown table nor become HTML; white space collapses to one space."""
    return re.sub(r"\s+", " ", text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|"))


def _align(column: TableRow) -> list[str]:
    width = max(map(len, column))
    if all(map(NUMBER.fullmatch, column[1:])):
        return [cell.rjust(width) for cell in column]
    return [cell.ljust(width) for cell in column]
