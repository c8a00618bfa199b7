"""Report tables for the terminal."""

from mdrive_sumo.core.tables import TableRow
from mdrive_sumo.report.comparison_report.report_table import ReportTable, format_cell


def format_text_rows(table: ReportTable) -> tuple[TableRow, list[TableRow]]:
    """Return header and rows of a table for `format_text_table`, without sections and marks."""
    header = tuple(f"{column.group} {column.label}".strip() for column in table.columns)
    rows: list[TableRow] = [
        tuple(format_cell(cell, column) for cell, column in zip(row.cells, table.columns, strict=True))
        for row in table.rows
    ]
    return header, rows
