"""CSV: the tables of all recordings as comma-separated UTF-8 text (RFC 4180), described by datapackage.json."""

import csv
import json
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path

from mdrive_sumo.export.export_tables import EXPORT_TABLES, describe_package
from mdrive_sumo.export.scored_recording import ScoredRecording


def write_csv(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one file per table with the rows of all recordings; a missing value is empty."""
    (folder / "datapackage.json").write_text(json.dumps(describe_package("csv"), indent=1) + "\n", encoding="utf-8")
    with ExitStack() as stack:
        writers = {}
        for table in EXPORT_TABLES:
            file = stack.enter_context((folder / f"{table.name}.csv").open("w", encoding="utf-8", newline=""))
            writers[table.name] = csv.writer(file)
            writers[table.name].writerow(column.name for column in table.columns)
        for recording in recordings:
            for table in EXPORT_TABLES:
                writers[table.name].writerows(zip(*table.build_rows(recording).values(), strict=True))
