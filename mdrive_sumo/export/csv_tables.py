"""CSV: the tables of all recordings as comma-separated UTF-8 text (RFC 4180), described by datapackage.json."""

import csv
import io
import json
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from mdrive_sumo.core.output_files import new_file, write_text
from mdrive_sumo.core.tables import clean_csv_row
from mdrive_sumo.export.export_tables import EXPORT_TABLES, describe_package
from mdrive_sumo.export.scored_recording import ScoredRecording


def write_csv(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one file per table with the rows of all recordings; a missing value is empty."""
    write_text(folder / "datapackage.json", json.dumps(describe_package("csv"), indent=1) + "\n")
    with ExitStack() as stack:
        writers = {}
        for table in EXPORT_TABLES:
            file = stack.enter_context(new_file(folder / f"{table.name}.csv"))
            text = stack.enter_context(io.TextIOWrapper(file, encoding="utf-8", errors="replace", newline=""))
            writers[table.name] = csv.writer(text)
            writers[table.name].writerow(column.name for column in table.columns)
        for recording in recordings:
            for table in EXPORT_TABLES:
                rows = zip(*table.build_rows(recording).values(), strict=True)
                writers[table.name].writerows(map(clean_csv_row, rows))
