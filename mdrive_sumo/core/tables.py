"""Table: a table as a value, with the marks of the best three, and its text for the terminal, Markdown and CSV.

LaTeX and HTML are written in `report`. Nothing beyond the standard library is needed, so `doctor` works on a broken
installation.
"""

import csv
import io
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.clean_text import clean_for_csv, clean_for_markdown, clean_line

if TYPE_CHECKING:
    from mdrive_sumo.core.statistics import ConfidenceInterval

CellValue = str | float | bool | None
"""None: undefined. A truth value is a property that an agent has or lacks, such as perception sharing."""
TOO_FEW = "too few"
"""What stands where the bounds of an interval would, over too few units."""
MARKED_RANKS = 3
"""First, second and third place are marked, as in the paper's main table (mdrive.tex, tab:mdrive_results)."""
MARKS_LEGEND = "**Bold**, (2) and (3) mark first, second and third place."
"""What a Markdown page with marked tables says about them."""
CSV_DECIMALS = 6
"""As in `results.json`."""
NUMBER = re.compile(r"[-+]?[\d.]*")
"""What a column of the terminal is right-aligned for: numbers, "-" for undefined ones, and empty cells."""


class BestValue(StrEnum):
    """Which values of a column are the best, so that the best three are marked."""

    NONE = "none"
    HIGHEST = "highest"
    LOWEST = "lowest"


class IntervalStyle(StrEnum):
    """How a table shows an interval: ± half its width, or both ends. CSV has both ends in any case."""

    HALF_WIDTH = "half-width"
    ENDS = "ends"


@dataclass(frozen=True, slots=True)
class Column:
    """A column. `key` names it in CSV; `group` stands above the labels of neighbouring columns."""

    key: str
    label: str
    group: str = ""
    decimals: int = 2
    best: BestValue = BestValue.NONE
    has_sign: bool = False
    """Whether positive numbers have a plus sign: differences."""
    intervals: IntervalStyle = IntervalStyle.HALF_WIDTH
    rank_group: str = ""
    """Where columns are agents: those of different groups are ranked apart, as `ComparedAgent.rank_group` has them."""
    undefined: str = "-"
    """What stands for an undefined value."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A value with its interval, if it has one, and its rank from 1 to 3; 0 for no mark."""

    value: CellValue
    interval: "ConfidenceInterval | None" = None
    rank: int = 0
    replay: Path | None = None
    """Where the replay page of a recorded episode lies or would lie, for the page of the report."""

    @property
    def number(self) -> float | None:
        """The value if it is a number."""
        return None if isinstance(self.value, str | bool) else self.value


@dataclass(frozen=True, slots=True)
class Row:
    """A row; `section` is the heading of the rows that it stands with. Rows that are not ranked have no marks.

    rank_group: where rows are agents, those of different groups are ranked apart.
    """

    cells: tuple[Cell, ...]
    section: str = ""
    is_ranked: bool = True
    rank_group: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table. In a report `name` is the stem of its files and, as `tab:NAME`, its label in LaTeX."""

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    note: str = ""
    """How to read it: definitions, and where they come from."""
    is_shaded: bool = False
    """Whether a page shades its numbers by their value from 0 to 100."""
    left: int | None = None
    """Number of columns at the left side that are aligned as text; None: those that hold text in every row."""

    @property
    def text_columns(self) -> int:
        """Number of columns at the left side that are aligned as text."""
        if self.left is not None:
            return self.left
        count = 0
        while count < len(self.columns) and all(isinstance(row.cells[count].value, str) for row in self.rows):
            count += 1
        return count

    @property
    def has_marks(self) -> bool:
        """Whether any cell is marked."""
        return any(cell.rank for row in self.rows for cell in row.cells)

    @property
    def labels(self) -> tuple[str, ...]:
        """The headings of the columns in one line, their groups before them."""
        return tuple(f"{column.group} {column.label}".strip() for column in self.columns)

    @property
    def groups(self) -> tuple[tuple[str, int], ...]:
        """Headings above the columns, each with its number of columns; empty if no column has one."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and spans[-1][0] == column.group and column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return tuple(spans) if any(name for name, _ in spans) else ()

    @property
    def sections(self) -> tuple[tuple[str, tuple[Row, ...]], ...]:
        """The rows by section, in the order of the first row of each."""
        rows: dict[str, list[Row]] = defaultdict(list)
        for row in self.rows:
            rows[row.section].append(row)
        return tuple((section, tuple(members)) for section, members in rows.items())

    def find_column(self, key: str) -> tuple[Cell, ...]:
        """Return the cells of a column by its key. Raises KeyError."""
        place = next((i for i, column in enumerate(self.columns) if column.key == key), None)
        if place is None:
            raise KeyError(f"table {self.name}: expected a column of {', '.join(c.key for c in self.columns)}: {key}")
        return tuple(row.cells[place] for row in self.rows)

    def mark_columns(self) -> "Table":
        """Return the table with the best three of each column marked; equal values as shown share a rank."""
        return replace(self, rows=self._mark_columns(self.rows))

    def mark_sections(self) -> "Table":
        """As `mark_columns`, each section on its own."""
        return replace(self, rows=tuple(row for _, rows in self.sections for row in self._mark_columns(rows)))

    def _mark_columns(self, rows: Sequence[Row]) -> tuple[Row, ...]:
        columns = [
            _rank([(row.cells[i], row.rank_group if row.is_ranked else None) for row in rows], column)
            for i, column in enumerate(self.columns)
        ]
        return tuple(replace(row, cells=cells) for row, cells in zip(rows, zip(*columns, strict=True), strict=True))

    def mark_rows(self) -> "Table":
        """As `mark_columns`, with the best three of each row, over the columns that say which values are best."""
        return replace(self, rows=tuple(self._mark_row(row) for row in self.rows))

    def _mark_row(self, row: Row) -> Row:
        ranked = [i for i, column in enumerate(self.columns) if column.best is not BestValue.NONE]
        if not ranked or not row.is_ranked:
            return row
        cells = _rank([(row.cells[i], self.columns[i].rank_group) for i in ranked], self.columns[ranked[0]])
        by_place = dict(zip(ranked, cells, strict=True))
        return replace(row, cells=tuple(by_place.get(i, cell) for i, cell in enumerate(row.cells)))


def _rank(cells: Sequence[tuple[Cell, str | None]], column: Column) -> list[Cell]:
    """Return cells, each given with its group (None: not ranked), with their ranks within the group: 1, 2, 2, 4, ...

    Ranks follow the values as the table shows them.
    """
    if column.best is BestValue.NONE:
        return [cell for cell, _ in cells]
    keys = [None if group is None else _sort_key(cell, column) for cell, group in cells]
    keys_by_group: dict[str | None, list[float]] = defaultdict(list)
    for (_, group), key in zip(cells, keys, strict=True):
        if key is not None:
            keys_by_group[group].append(key)
    return [
        replace(cell, rank=_find_rank(key, keys_by_group[group]))
        for (cell, group), key in zip(cells, keys, strict=True)
    ]


def _find_rank(key: float | None, keys: Sequence[float]) -> int:
    """Return the rank from 1 to 3 among the keys; 0 for none, and where all share one: that is no place."""
    if key is None or len(set(keys)) < 2:
        return 0
    rank = 1 + sum(other < key for other in keys)
    return rank if rank <= MARKED_RANKS else 0


def _sort_key(cell: Cell, column: Column) -> float | None:
    if cell.number is None:
        return None
    value = round(cell.number, column.decimals)
    return -value if column.best is BestValue.HIGHEST else value


def make_row(
    values: Iterable[CellValue | Cell], section: str = "", *, is_ranked: bool = True, rank_group: str = ""
) -> Row:
    """Return a row of values or cells."""
    cells = (value if isinstance(value, Cell) else Cell(value) for value in values)
    return Row(tuple(cells), section, is_ranked, rank_group)


def make_text_columns(labels: Mapping[str, str]) -> tuple[Column, ...]:
    """Return columns of text by key and label."""
    return tuple(Column(key, label) for key, label in labels.items())


def make_text_table(header: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> Table:
    """Return a table whose cells are texts already. left: number of columns that are aligned as text."""
    columns = tuple(Column(label, label) for label in header)
    return Table("", "", columns, tuple(make_row(row) for row in rows), left=left)


def format_cell(cell: Cell, column: Column) -> str:
    """Return a cell's text without its mark: ✓ or × for a property, a number with its interval."""
    value = cell.value
    if value is None:
        return column.undefined
    if isinstance(value, bool):
        return "✓" if value else "×"
    if isinstance(value, str):
        return value
    return _format_number(value, column) + format_cell_interval(cell, column)


def format_cell_interval(cell: Cell, column: Column) -> str:
    """Return what follows a cell's number: " ± 1.20" or " [80.00, 88.00]"; "" without an interval.

    Both ends are missed more than half a width: " [too few]" says why there are none.
    """
    interval = cell.interval
    if interval is None or (interval.ends is None and column.intervals is IntervalStyle.HALF_WIDTH):
        return ""
    if interval.ends is None:
        return f" [{TOO_FEW}]"
    low, high = interval.ends
    if column.intervals is IntervalStyle.ENDS:
        return f" [{_format_number(low, column)}, {_format_number(high, column)}]"
    return f" ± {(high - low) / 2:.{column.decimals}f}"


def _format_number(value: float, column: Column) -> str:
    return f"{round(value, column.decimals) + 0.0:{'+' if column.has_sign else ''}.{column.decimals}f}"


def format_text(table: Table) -> str:
    """Return an aligned table for the terminal, without marks, title and note; headings of sections are rows.

    Columns of numbers are right-aligned, all others left-aligned.
    """
    lines: list[Sequence[str]] = [table.labels]
    for section, rows in table.sections:
        lines += [(f"{section}:", *[""] * (len(table.columns) - 1))] if section else []
        lines += [[format_cell(*pair) for pair in zip(row.cells, table.columns, strict=True)] for row in rows]
    columns = [_align([clean_line(text) for text in column]) for column in zip(*lines, strict=True)]
    head, *body = ["  ".join(texts).rstrip() for texts in zip(*columns, strict=True)]
    return "\n".join((head, "-" * max(map(len, (head, *body))), *body))


def _align(texts: Sequence[str]) -> list[str]:
    width = max(map(len, texts))
    if all(map(NUMBER.fullmatch, texts[1:])):
        return [text.rjust(width) for text in texts]
    return [text.ljust(width) for text in texts]


def format_markdown(table: Table) -> str:
    """Return a table as Markdown, without title and note; groups stand before the labels, sections are rows."""
    lines: list[Sequence[str]] = [table.labels]
    for section, rows in table.sections:
        if section:
            lines.append([f"*{section}*", *[""] * (len(table.columns) - 1)])
        lines += [[_format_marked(*pair) for pair in zip(row.cells, table.columns, strict=True)] for row in rows]
    rule = ["---" if i < table.text_columns else "---:" for i in range(len(table.columns))]
    head, *body = [[clean_for_markdown(text) for text in line] for line in lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *body))


def join_paragraphs(parts: Iterable[str]) -> str:
    """Return a page of Markdown of its paragraphs and tables, without empty ones."""
    return "\n\n".join(part for part in parts if part) + "\n"


def _format_marked(cell: Cell, column: Column) -> str:
    text = format_cell(cell, column)
    return {1: f"**{text}**", 2: f"{text} (2)", 3: f"{text} (3)"}.get(cell.rank, text)


def format_csv(table: Table) -> str:
    """Return a table as CSV: one line of column keys, numbers in full; undefined is empty, properties are yes or no.

    A column whose cells have intervals is followed by KEY_low and KEY_high. Sections are the first column.
    """
    has_sections = any(row.section for row in table.rows)
    with_intervals = [any(row.cells[i].interval is not None for row in table.rows) for i in range(len(table.columns))]
    header = ["section"] if has_sections else []
    for column, has_interval in zip(table.columns, with_intervals, strict=True):
        header += [column.key, *((f"{column.key}_low", f"{column.key}_high") if has_interval else ())]
    lines = [header]
    for row in table.rows:
        line = [row.section] if has_sections else []
        for cell, has_interval in zip(row.cells, with_intervals, strict=True):
            line.append(_format_csv_value(cell.value))
            if has_interval:
                ends = cell.interval.ends if cell.interval else None
                line += [_format_csv_value(end) for end in ends or (None, None)]
        lines.append(line)
    return format_csv_lines(lines)


def _format_csv_value(value: CellValue) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    return f"{round(value, CSV_DECIMALS) + 0.0:.{CSV_DECIMALS}f}".rstrip("0").rstrip(".")


def format_csv_lines(lines: Iterable[Iterable[object]]) -> str:
    """Return lines of CSV (RFC 4180, but with line feeds)."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(clean_csv_row, lines))
    return text.getvalue()


def clean_csv_row(row: Iterable[object]) -> list[object]:
    """Return the cells of a CSV table, of which no text is a formula; numbers stay numbers."""
    return [clean_for_csv(cell) if isinstance(cell, str) else cell for cell in row]
