"""Read columns of parquet and feather tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from real2sim.readers.optional_package import build_missing_error

Columns = Mapping[str, npt.NDArray[Any]]


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


MAX_TABLE_BYTES = 2**33
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
        with open_regular(path, MAX_TABLE_BYTES):
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
