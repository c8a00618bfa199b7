"""Report tables as CSV: one line of column keys, full precision, both ends of every interval."""

from mdrive_sumo.core.tables import format_csv_table
from mdrive_sumo.report.comparison_report.report_table import CellValue, ReportTable

DECIMALS = 6
"""As in `results.json`."""


def format_csv(table: ReportTable) -> str:
    """Return a table as CSV (RFC 4180); undefined values are empty, properties are yes or no.

    A column whose cells have intervals is followed by KEY_low and KEY_high. Sections are the first column.
    """
    has_sections = any(row.section for row in table.rows)
    with_intervals = [any(row.cells[i].interval is not None for row in table.rows) for i in range(len(table.columns))]
    header = ["section"] if has_sections else []
    for column, has_interval in zip(table.columns, with_intervals, strict=True):
        header += [column.key, *((f"{column.key}_low", f"{column.key}_high") if has_interval else ())]
    lines: list[list[str]] = []
    for row in table.rows:
        line = [row.section] if has_sections else []
        for cell, has_interval in zip(row.cells, with_intervals, strict=True):
            line.append(_format_value(cell.value))
            if has_interval:
                ends = cell.interval.ends if cell.interval else None
                line += [_format_value(end) for end in ends or (None, None)]
        lines.append(line)
    return format_csv_table(header, lines)


def _format_value(value: CellValue) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".")
