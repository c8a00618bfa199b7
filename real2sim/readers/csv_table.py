"""Read tables of comma-separated values of strangers."""

import csv
import io
import math
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular

MAX_TABLE_BYTES = 2**32
"""Of a file; the largest of INTERACTION have 200 MB."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """The wanted cells of a row, in the order of the wanted columns."""

    where: str
    """File and line, for errors."""
    cells: tuple[str, ...]

    def parse_number(self, column: int, name: str) -> float:
        """Return a cell as a finite number; raise InputError."""
        try:
            value = float(self.cells[column])
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"{self.where}: {name}: expected a finite number, found {self.cells[column]!r}")
        return value


@contextmanager
def open_table(path: Path) -> Generator[Iterator[list[str]]]:
    """Open a table for reading, with or without a byte order mark; raise InputError, also while it is read."""
    try:
        with open_regular(path, MAX_TABLE_BYTES) as data:
            yield csv.reader(io.TextIOWrapper(data, encoding="utf-8-sig", newline=""))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a table of comma-separated values, found: {error}") from None


def read_header(table: Iterator[list[str]]) -> list[str]:
    """Return the names of the columns."""
    return [name.strip() for name in next(table, [])]


def find_columns(path: Path, header: Sequence[str], wanted: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the wanted columns; raise InputError for one that is missing."""
    missing = [name for name in wanted if name not in header]
    if missing:
        found = " ".join(", ".join(header).split())[:200] or "none"
        raise InputError(f"{path}: expected the column {missing[0]}, found {found}")
    return tuple(header.index(name) for name in wanted)


def read_rows(path: Path, wanted: Sequence[str]) -> Iterator[TableRow]:
    """Yield the wanted cells of every row; raise InputError."""
    with open_table(path) as table:
        header = read_header(table)
        columns = find_columns(path, header, wanted)
        for line, cells in enumerate(table, start=2):
            if not cells:
                continue
            if len(cells) != len(header):
                raise InputError(f"{path}: line {line}: expected {len(header)} columns, found {len(cells)}")
            yield TableRow(f"{path}: line {line}", tuple(cells[column] for column in columns))
