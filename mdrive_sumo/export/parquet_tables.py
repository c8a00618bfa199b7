"""Parquet: tables, typed; units and descriptions are metadata of the columns."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mdrive_sumo.export.export_tables import EXPORT_TABLES, build_parts
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.export.table_files import DescribedTable, TableParts

ARROW_TYPES = {"string": pa.string(), "integer": pa.int64(), "number": pa.float64(), "boolean": pa.bool_()}


def write_parquet(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one file per table with the rows of all recordings."""
    write_parquet_tables(EXPORT_TABLES, map(build_parts, recordings), folder)


def write_parquet_tables(tables: Sequence[DescribedTable], parts: Iterable[TableParts], folder: Path) -> None:
    """Write one file per table, a row group per part; a missing value is null."""
    schemas = {table.name: _build_schema(table) for table in tables}
    with ExitStack() as stack:
        writers = {
            name: stack.enter_context(pq.ParquetWriter(folder / f"{name}.parquet", schema, compression="zstd"))
            for name, schema in schemas.items()
        }
        for part in parts:
            for name, schema in schemas.items():
                writers[name].write_table(pa.table(dict(part[name]), schema=schema))


def _build_schema(table: DescribedTable) -> Any:
    fields = [
        pa.field(
            column.name, ARROW_TYPES[column.type], metadata={"unit": column.unit, "description": column.description}
        )
        for column in table.columns
    ]
    return pa.schema(fields, metadata={"description": table.description})
