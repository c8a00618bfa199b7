"""Values of published tables: scores by scenario and seed of some runs in one small Parquet file.

Parquet keeps types and is small; `pyarrow` comes with the extras `convert` and `export`. Any reader of Parquet shows
the columns; the settings of the runs are JSON in the metadata of the file.
"""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, summarize_run

FORMAT = "mdrive-sumo/published-values/1"
SCORES = ("ds", "sr", "rc", "ip", "efficient_sr", "time_ratio", "min_ttc")
TEXTS = ("id", "bucket", "category", "place", "status", "reason")
SCHEMA = pa.schema(
    [("run", pa.int16()), ("agent", pa.string()), ("seed", pa.int32())]
    + [(name, pa.string()) for name in TEXTS]
    + [(name, pa.float64()) for name in SCORES]
)
"""run: index of the run in the metadata `runs`, whose agent is repeated. All other columns are those of results."""
LEFT_OUT: dict[str, Any] = {"digest": "", "ticks": 0, "egos": ()}
"""Fields of results that no table needs."""


def write_values(path: Path, runs: Sequence[Results]) -> None:
    """Write the values of runs. Raises InputError if that is not possible."""
    rows = [
        {"run": i, "agent": results.run.agent, **{name: getattr(one, name) for name in ("seed", *TEXTS, *SCORES)}}
        for i, results in enumerate(runs)
        for one in results.scenarios
    ]
    about = {"format": FORMAT, "runs": json.dumps([results.run.model_dump(mode="json") for results in runs])}
    table = pa.Table.from_pylist(rows, SCHEMA.with_metadata(about))
    data = io.BytesIO()
    pq.write_table(table, data, compression="zstd")
    make_parents(path)
    write_bytes(path, data.getvalue())


def read_values(path: Path) -> tuple[Results, ...]:
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
    rows = table.to_pylist()
    try:
        infos = [RunInfo.model_validate(run) for run in json.loads(about.get("runs", "[]"))]
        scenarios = [(row["run"], _make_result(row)) for row in rows]
    except (ValueError, ValidationError) as error:
        raise InputError(f"{path}: expected runs and scores of this version: {error}") from None
    return tuple(
        summarize_run(info, [one for run, one in scenarios if run == number]) for number, info in enumerate(infos)
    )


def _make_result(row: dict[str, Any]) -> ScenarioResult:
    return ScenarioResult.model_validate({name: row[name] for name in ("seed", *TEXTS, *SCORES)} | LEFT_OUT)
