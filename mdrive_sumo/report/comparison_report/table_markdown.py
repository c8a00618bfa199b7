"""Report tables as Markdown."""

from mdrive_sumo.core.tables import format_markdown_table
from mdrive_sumo.report.comparison_report.report_table import ReportCell, ReportColumn, ReportTable, format_cell

MARKS_LEGEND = "**Bold**, (2) and (3) mark first, second and third place."


def format_markdown(table: ReportTable) -> str:
    """Return a table as Markdown, without title and note; groups stand before the labels, sections are rows."""
    header = [f"{column.group} {column.label}".strip() for column in table.columns]
    rows: list[list[str]] = []
    for section, found in table.sections:
        if section:
            rows.append([f"*{section}*", *[""] * (len(header) - 1)])
        rows += [
            [_format_marked(cell, column) for cell, column in zip(row.cells, table.columns, strict=True)]
            for row in found
        ]
    return format_markdown_table(header, rows, left=count_text_columns(table))


def count_text_columns(table: ReportTable) -> int:
    """Return how many columns at the left side hold text in every row."""
    count = 0
    while count < len(table.columns) and all(isinstance(row.cells[count].value, str) for row in table.rows):
        count += 1
    return count


def has_marks(table: ReportTable) -> bool:
    """Return whether any cell of a table is marked."""
    return any(cell.rank for row in table.rows for cell in row.cells)


def _format_marked(cell: ReportCell, column: ReportColumn) -> str:
    text = format_cell(cell, column)
    return {1: f"**{text}**", 2: f"{text} (2)", 3: f"{text} (3)"}.get(cell.rank, text)
