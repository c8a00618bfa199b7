"""Parquet: the tables of all recordings, typed; units and descriptions are metadata of the columns."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mdrive_sumo.export.export_tables import EXPORT_TABLES, ExportTable
from mdrive_sumo.export.scored_recording import ScoredRecording

ARROW_TYPES = {"string": pa.string(), "integer": pa.int64(), "number": pa.float64(), "boolean": pa.bool_()}


def write_parquet(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one file per table, a row group per recording; a missing value is null."""
    schemas = {table.name: _build_schema(table) for table in EXPORT_TABLES}
    with ExitStack() as stack:
        writers = {
            name: stack.enter_context(pq.ParquetWriter(folder / f"{name}.parquet", schema, compression="zstd"))
            for name, schema in schemas.items()
        }
        for recording in recordings:
            for table in EXPORT_TABLES:
                rows = table.build_rows(recording)
                writers[table.name].write_table(pa.table(dict(rows), schema=schemas[table.name]))


def _build_schema(table: ExportTable) -> Any:
    fields = [
        pa.field(
            column.name, ARROW_TYPES[column.type], metadata={"unit": column.unit, "description": column.description}
        )
        for column in table.columns
    ]
    return pa.schema(fields, metadata={"description": table.description})
