"""Read tables of strangers: comma-separated values, and parquet and feather files."""

import csv
import io
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from real2sim.readers.input_checks import build_missing_error

MAX_TABLE_BYTES = 2**32
"""Of a file; the largest of INTERACTION have 200 MB."""
Columns = Mapping[str, npt.NDArray[Any]]


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
        columns = " ".join(", ".join(header).split())[:200] or "none"
        raise InputError(f"{path}: expected the column {missing[0]}, found {columns}")
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


def read_columns(path: Path, numbers: tuple[str, ...], words: tuple[str, ...] = ()) -> Columns:
    """Read columns of a `.parquet` or `.feather` file; `numbers` must be finite; raise InputError.

    Integers stay integers: a time in nanoseconds does not fit a float.
    """
    table = _read_table(path)
    missing = [name for name in (*numbers, *words) if name not in table.column_names]
    if missing:
        raise InputError(f"{path}: expected the column {missing[0]}, found {', '.join(table.column_names) or 'none'}")
    if not table.num_rows:
        raise InputError(f"{path}: expected at least one row, found an empty table")
    return {name: _read_numbers(path, name, table[name]) for name in numbers} | {
        name: np.array(table[name].to_pylist(), dtype=np.str_) for name in words
    }


MAX_ARROW_BYTES = 2**33
"""Of a file; the largest of Argoverse 2 have 100 MB."""


def _read_table(path: Path) -> Any:
    """Read a table. pyarrow is imported here because only Argoverse 2 needs it and the import is slow."""
    try:
        import pyarrow
        from pyarrow import feather, parquet
    except ImportError:
        raise build_missing_error(path, "pyarrow") from None
    reader: Any = parquet.read_table if path.suffix == ".parquet" else feather.read_table
    try:
        with open_regular(path, MAX_ARROW_BYTES):
            pass  # a device or a pipe would not end
        table = reader(path)
        table.validate(full=True)  # otherwise offsets of a damaged file are addresses that crash the process
        if not all(map(str.isprintable, table.column_names)):
            raise InputError(f"{path}: expected columns with names, found {ascii(table.column_names)[:80]}")
        return table
    except FileNotFoundError:
        raise InputError(f"{path}: expected a {path.suffix[1:]} table, found no such file") from None
    except (OSError, pyarrow.ArrowException, UnicodeDecodeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path}: expected a complete {path.suffix[1:]} table, found: {reason}") from None


def _read_numbers(path: Path, name: str, column: Any) -> npt.NDArray[Any]:
    values = column.to_numpy()
    if values.dtype.kind not in "iuf":
        raise InputError(f"{path}: {name}: expected numbers, found {column.type}")
    bad = ~np.isfinite(values)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise InputError(f"{path}: {name}: expected finite numbers, found {values[row]} in row {row}")
    return values
