"""ReportTable: a table as a value, with the marks of the best three, which writers turn into files."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from mdrive_sumo.core.statistics import TOO_FEW, ConfidenceInterval

CellValue = str | float | bool | None
"""None: undefined. A truth value is a property that an agent has or lacks, such as perception sharing."""
UNDEFINED = "-"
MARKED_RANKS = 3
"""First, second and third place are marked, as in the paper's main table (mdrive.tex, tab:mdrive_results)."""


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
class ReportColumn:
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


@dataclass(frozen=True, slots=True)
class ReportCell:
    """A value with its interval, if it has one, and its rank from 1 to 3; 0 for no mark."""

    value: CellValue
    interval: ConfidenceInterval | None = None
    rank: int = 0
    replay: Path | None = None
    """Where the replay page of a recorded episode lies or would lie, for the page of the report."""

    @property
    def number(self) -> float | None:
        """The value if it is a number."""
        return None if isinstance(self.value, str | bool) else self.value


@dataclass(frozen=True, slots=True)
class ReportRow:
    """A row; `section` is the heading of the rows that it stands with. Rows that are not ranked have no marks.

    rank_group: where rows are agents, those of different groups are ranked apart.
    """

    cells: tuple[ReportCell, ...]
    section: str = ""
    is_ranked: bool = True
    rank_group: str = ""


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table of a report. `name` is the stem of its files and, as `tab:NAME`, its label in LaTeX."""

    name: str
    title: str
    columns: tuple[ReportColumn, ...]
    rows: tuple[ReportRow, ...]
    note: str = ""
    """How to read it: definitions, and where they come from."""
    is_shaded: bool = False
    """Whether a page shades its numbers by their value from 0 to 100."""

    @property
    def groups(self) -> tuple[tuple[str, int], ...]:
        """Headings above the columns, each with its number of columns; empty if no column has one."""
        found: list[tuple[str, int]] = []
        for column in self.columns:
            if found and found[-1][0] == column.group and column.group:
                found[-1] = (column.group, found[-1][1] + 1)
            else:
                found.append((column.group, 1))
        return tuple(found) if any(name for name, _ in found) else ()

    @property
    def sections(self) -> tuple[tuple[str, tuple[ReportRow, ...]], ...]:
        """The rows by section, in the order of the first row of each."""
        rows: dict[str, list[ReportRow]] = defaultdict(list)
        for row in self.rows:
            rows[row.section].append(row)
        return tuple((name, tuple(found)) for name, found in rows.items())

    def find_column(self, key: str) -> tuple[ReportCell, ...]:
        """Return the cells of a column by its key. Raises KeyError."""
        place = next((i for i, column in enumerate(self.columns) if column.key == key), None)
        if place is None:
            raise KeyError(f"table {self.name}: expected a column of {', '.join(c.key for c in self.columns)}: {key}")
        return tuple(row.cells[place] for row in self.rows)

    def mark_columns(self) -> "ReportTable":
        """Return the table with the best three of each column marked; equal values as shown share a rank."""
        return replace(self, rows=self._mark_columns(self.rows))

    def mark_sections(self) -> "ReportTable":
        """As `mark_columns`, each section on its own."""
        return replace(self, rows=tuple(row for _, rows in self.sections for row in self._mark_columns(rows)))

    def _mark_columns(self, rows: Sequence[ReportRow]) -> tuple[ReportRow, ...]:
        columns = [
            _rank([(row.cells[i], row.rank_group if row.is_ranked else None) for row in rows], column)
            for i, column in enumerate(self.columns)
        ]
        return tuple(
            replace(row, cells=tuple(cells)) for row, cells in zip(rows, zip(*columns, strict=True), strict=True)
        )

    def mark_rows(self) -> "ReportTable":
        """As `mark_columns`, with the best three of each row, over the columns that say which values are best."""
        return replace(self, rows=tuple(self._mark_row(row) for row in self.rows))

    def _mark_row(self, row: ReportRow) -> ReportRow:
        ranked = [i for i, column in enumerate(self.columns) if column.best is not BestValue.NONE]
        if not ranked or not row.is_ranked:
            return row
        cells = _rank([(row.cells[i], self.columns[i].rank_group) for i in ranked], self.columns[ranked[0]])
        by_place = dict(zip(ranked, cells, strict=True))
        return replace(row, cells=tuple(by_place.get(i, cell) for i, cell in enumerate(row.cells)))


def _rank(cells: Sequence[tuple[ReportCell, str | None]], column: ReportColumn) -> list[ReportCell]:
    """Return cells, each given with its group (None: not ranked), with their ranks within the group: 1, 2, 2, 4, ...

    Ranks follow the values as the table shows them.
    """
    if column.best is BestValue.NONE:
        return [cell for cell, _ in cells]
    shown = [None if group is None else _sort_key(cell, column) for cell, group in cells]
    groups = [group for _, group in cells]
    by_group: dict[str | None, list[float]] = defaultdict(list)
    for group, key in zip(groups, shown, strict=True):
        if key is not None:
            by_group[group].append(key)
    return [
        replace(cell, rank=_find_rank(key, by_group[group])) for (cell, group), key in zip(cells, shown, strict=True)
    ]


def _find_rank(key: float | None, known: Sequence[float]) -> int:
    """Return the rank from 1 to 3 among the keys; 0 for none, and where all share one: that is no place."""
    if key is None or len(set(known)) < 2:
        return 0
    rank = 1 + sum(other < key for other in known)
    return rank if rank <= MARKED_RANKS else 0


def _sort_key(cell: ReportCell, column: ReportColumn) -> float | None:
    if cell.number is None:
        return None
    value = round(cell.number, column.decimals)
    return -value if column.best is BestValue.HIGHEST else value


def format_cell(cell: ReportCell, column: ReportColumn) -> str:
    """Return a cell's text without its mark: "-" where it is undefined, ✓ or ×, a number with its interval."""
    value = cell.value
    if value is None:
        return UNDEFINED
    if isinstance(value, bool):
        return "✓" if value else "×"
    if isinstance(value, str):
        return value
    return _format_number(value, column) + format_cell_interval(cell, column)


def format_cell_interval(cell: ReportCell, column: ReportColumn) -> str:
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


def _format_number(value: float, column: ReportColumn) -> str:
    return f"{round(value, column.decimals) + 0.0:{'+' if column.has_sign else ''}.{column.decimals}f}"


def make_row(
    values: Iterable[CellValue | ReportCell], section: str = "", *, is_ranked: bool = True, rank_group: str = ""
) -> ReportRow:
    """Return a row of values or cells."""
    cells = (value if isinstance(value, ReportCell) else ReportCell(value) for value in values)
    return ReportRow(tuple(cells), section, is_ranked, rank_group)


def make_text_columns(labels: Mapping[str, str]) -> tuple[ReportColumn, ...]:
    """Return columns of text by key and label."""
    return tuple(ReportColumn(key, label) for key, label in labels.items())
