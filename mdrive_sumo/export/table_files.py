"""Tables as files: CSV with a Data Package that describes them."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from mdrive_sumo.core.output_files import new_file, write_text
from mdrive_sumo.core.tables import clean_csv_row

ColumnType = Literal["string", "integer", "number", "boolean"]
"""As in the Data Package standard (specs.frictionlessdata.io)."""
Columns = Mapping[str, Sequence[Any]]
"""Values by column name; None where there is none."""
TableParts = Mapping[str, Columns]
"""Rows of an episode, by table; each table has all its columns, in their order."""


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A column; `unit` is "" where there is none."""

    name: str
    type: ColumnType
    unit: str
    description: str


class DescribedTable(Protocol):
    """What files say of a table."""

    @property
    def name(self) -> str:
        """Name of its file, without ending."""
        ...

    @property
    def description(self) -> str:
        """What its rows are."""
        ...

    @property
    def columns(self) -> tuple[TableColumn, ...]:
        """All columns."""
        ...


def describe_package(tables: Sequence[DescribedTable], extension: str) -> dict[str, Any]:
    """Return a Data Package descriptor of the tables, for files with that extension."""
    return {
        "name": "mdrive-sumo-export",
        "profile": "tabular-data-package",
        "resources": [
            {
                "name": table.name,
                "profile": "tabular-data-resource",  # the package's profile asks for it in every resource
                "path": f"{table.name}.{extension}",
                "encoding": "utf-8",
                "description": table.description,
                "schema": {
                    "fields": [
                        {"name": c.name, "type": c.type, "description": c.description}
                        | ({"unit": c.unit} if c.unit else {})
                        for c in table.columns
                    ]
                },
            }
            for table in tables
        ],
    }


def write_csv_tables(tables: Sequence[DescribedTable], parts: Iterable[TableParts], folder: Path) -> None:
    """Write one file per table with the rows of all parts; a missing value is empty."""
    write_text(folder / "datapackage.json", json.dumps(describe_package(tables, "csv"), indent=1) + "\n")
    with ExitStack() as stack:
        writers = {}
        for table in tables:
            file = stack.enter_context(new_file(folder / f"{table.name}.csv"))
            text = stack.enter_context(io.TextIOWrapper(file, encoding="utf-8", errors="replace", newline=""))
            writers[table.name] = csv.writer(text)
            writers[table.name].writerow(column.name for column in table.columns)
        for part in parts:
            for table in tables:
                writers[table.name].writerows(map(clean_csv_row, zip(*part[table.name].values(), strict=True)))
