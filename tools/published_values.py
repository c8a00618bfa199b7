"""Values of published tables: scores by scenario and seed of some runs in one small Parquet file.

Parquet keeps types and is small; `pyarrow` comes with the extras `convert` and `export`. Any reader of Parquet shows
the columns; the settings of the runs are JSON in the metadata of the file.
"""

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, summarize_run

FORMAT = "mdrive-sumo/published-values/2"
SCORES = ("ds", "sr", "rc", "ip", "efficient_sr", "time_ratio", "min_ttc")
TEXTS = ("id", "bucket", "category", "place", "status", "reason")
SCHEMA = pa.schema(
    [("run", pa.int16()), ("part", pa.string()), ("agent", pa.string()), ("seed", pa.int32())]
    + [(name, pa.string()) for name in TEXTS]
    + [(name, pa.float64()) for name in SCORES]
)
"""run: index of the run in the metadata `runs`. part: of the study (`Values`). agent: whose scores these are. All other
columns are those of results."""
Values = Mapping[str, Sequence[Results]]
"""Runs by part of a study; those that are no part of one are `WHOLE`."""
WHOLE = ""
LEFT_OUT: dict[str, Any] = {"digest": "", "ticks": 0, "egos": ()}
"""Fields of results that no table needs."""


def write_values(path: Path, values: Values) -> None:
    """Write the values of runs. Raises InputError if that is not possible."""
    runs = [(part, results) for part, found in values.items() for results in found]
    rows = [
        {"run": i, "part": part, "agent": find_compared_agent(results.run)}
        | {name: getattr(one, name) for name in ("seed", *TEXTS, *SCORES)}
        for i, (part, results) in enumerate(runs)
        for one in results.scenarios
    ]
    about = {"format": FORMAT, "runs": json.dumps([results.run.model_dump(mode="json") for _, results in runs])}
    table = pa.Table.from_pylist(rows, SCHEMA.with_metadata(about))
    data = io.BytesIO()
    pq.write_table(table, data, compression="zstd")
    make_parents(path)
    write_bytes(path, data.getvalue())


def find_compared_agent(run: RunInfo) -> str:
    """Return the agent that a table compares: the second one, where the first is a stranger among its CAVs."""
    return run.others or run.agent


def read_values(path: Path) -> Values:
    """Return the runs of a file, without CAVs. Raises InputError for a damaged file and for one of another version."""
    try:
        table = pq.read_table(io.BytesIO(read_bytes(path)))
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: expected a Parquet file of values, found one that cannot be read: {error}") from None
    about = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if (found := about.get("format", "none")) != FORMAT:
        raise InputError(
            f"{path}: format: expected {FORMAT}, found {found}; `python -m tools.write_published_tables --values NAME"
            " RUN...` writes it anew"
        )
    if not table.schema.equals(SCHEMA):
        raise InputError(
            f"{path}: expected the columns {', '.join(SCHEMA.names)}, found {', '.join(table.schema.names)}"
        )
    scenarios: dict[tuple[str, int], list[ScenarioResult]] = {}
    try:
        infos = [RunInfo.model_validate(run) for run in json.loads(about.get("runs", "[]"))]
        for row in table.to_pylist():
            scenarios.setdefault((row["part"], row["run"]), []).append(_make_result(row))
    except (ValueError, ValidationError) as error:
        raise InputError(f"{path}: expected runs and scores of this version: {error}") from None
    values: dict[str, list[Results]] = {}
    for (part, number), members in scenarios.items():
        if not 0 <= number < len(infos):
            raise InputError(f"{path}: run: expected one of {len(infos)} runs, found number {number}")
        found = summarize_run(infos[number], members)  # without messages, of which the labels follow
        values.setdefault(part, []).append(found.model_copy(update={"run": infos[number]}))
    return values


def _make_result(row: dict[str, Any]) -> ScenarioResult:
    return ScenarioResult.model_validate({name: row[name] for name in ("seed", *TEXTS, *SCORES)} | LEFT_OUT)
