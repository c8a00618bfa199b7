"""Values of published tables: scores by scenario and seed of some runs in one small Parquet file.

Parquet keeps types and is small; `pyarrow` comes with the extras `convert` and `export`. Any reader of Parquet shows
the columns; the settings of the runs are JSON in the metadata of the file.
"""

import io
import json
import math
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.open_loop import OpenLoopResults, OpenLoopScenario
from mdrive_sumo.open_loop.results import OpenLoopRunInfo, summarize_open_loop
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
LOADS = ("messages_s", "bytes_s", "busy_mean", "busy_greatest")
"""Further columns of files in which some run took a radio: what was sent in a second, and how busy the channel was."""
SENT_RATE = "cav_kbit_s"
"""Further column of files with budgets: payloads that a CAV sends, of all types [kbit/s], mean over the episode and its
CAVs. In results that are read from a file it is a scalar of this name."""
BUDGET_PART = r"budget-(\d+)"
"""Part of the runs with a budget of so many bytes: the name of their folder."""
LOAD_SCHEMA = pa.schema([*SCHEMA, *((name, pa.float64()) for name in LOADS)])
SENT_SCHEMA = pa.schema([*SCHEMA, (SENT_RATE, pa.float64())])
ALL_TYPES = "(all)"
"""Whose rates a file holds: those of all types together."""
OPEN_SCHEMA = pa.schema(
    [("run", pa.int16()), ("agent", pa.string()), ("seed", pa.int32())]
    + [(name, pa.string()) for name in ("id", "bucket", "category", "precision_counts")]
    + [(name, pa.int32()) for name in ("frames", "detections", "truths")]
    + [(name, pa.float64()) for name in ("ap50", "ade", "fde", "cr", "cr_frames", "cr_mdrive", "overlap")]
)
"""As above, of open loop. precision_counts: JSON, as in `open_loop.json`."""
OPEN_LEFT_OUT: dict[str, Any] = {"digest": "", "skipped": {}, "failures": {}}
InfoT = TypeVar("InfoT", bound=BaseModel)
VALUES_FOLDER = Path(__file__).parents[1] / "docs/results/values"
Values = Mapping[str, Sequence[Results]]
"""Runs by part of a study; those that are no part of one are `WHOLE`."""
WHOLE = ""
LEFT_OUT: dict[str, Any] = {"digest": "", "ticks": 0, "egos": ()}
"""Fields of results that no table needs."""


def write_values(path: Path, values: Values, opened: Sequence[OpenLoopResults] = ()) -> None:
    """Write the values of runs, and beside them those of open loop if there are any. Raises InputError."""
    runs = [(part, results) for part, found in values.items() for results in found]
    has_budgets = any(re.fullmatch(BUDGET_PART, part) for part in values)
    rows = [
        {"run": i, "part": part, "agent": find_compared_agent(results.run)}
        | {name: getattr(one, name) for name in ("seed", *TEXTS, *SCORES)}
        | ({SENT_RATE: _compute_sent_rate(one)} if has_budgets else _list_loads(one))
        for i, (part, results) in enumerate(runs)
        for one in results.scenarios
    ]
    has_loads = any(not row.keys().isdisjoint(LOADS) for row in rows)
    schema = SENT_SCHEMA if has_budgets else LOAD_SCHEMA if has_loads else SCHEMA
    _write_table(path, rows, schema, [results.run for _, results in runs])
    if opened:
        shown = [
            {"run": i, "agent": results.run.agent}
            | one.model_dump(include={*OPEN_SCHEMA.names})
            | {"precision_counts": json.dumps(one.precision_counts)}
            for i, results in enumerate(opened)
            for one in results.scenarios
        ]
        _write_table(name_open_file(path), shown, OPEN_SCHEMA, [results.run for results in opened])


def _compute_sent_rate(one: ScenarioResult) -> float | None:
    """Return what a CAV sends [kbit/s]; None where it was not measured."""
    rate = one.scalars.get("message_rate")  # bytes a second, of all CAVs
    if rate is None or not one.egos:
        return one.scalars.get(SENT_RATE)
    return rate * 8 / 1000 / len(one.egos)


def _list_loads(one: ScenarioResult) -> dict[str, float]:
    """Return the columns `LOADS`, as far as they were measured."""
    found: dict[str, float] = {}
    if rates := one.sent_rates.values():
        found["messages_s"] = math.fsum(rate.messages_s for rate in rates)
        found["bytes_s"] = math.fsum(rate.bytes_s for rate in rates)
    if one.busy_ratio is not None:
        found |= {"busy_mean": one.busy_ratio.mean, "busy_greatest": one.busy_ratio.greatest}
    return found


def _write_table(path: Path, rows: list[dict[str, Any]], schema: Any, runs: Sequence[BaseModel]) -> None:
    about = {"format": FORMAT, "runs": json.dumps([run.model_dump(mode="json") for run in runs])}
    data = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema.with_metadata(about)), data, compression="zstd")
    make_parents(path)
    write_bytes(path, data.getvalue())


def name_open_file(path: Path) -> Path:
    """Return the file of the open loop of some runs."""
    return path.with_name(f"{path.stem}-open{path.suffix}")


def find_compared_agent(run: RunInfo) -> str:
    """Return the agent that a table compares: the second one, where the first is a stranger among its CAVs."""
    return run.others or run.agent


def read_values(path: Path) -> Values:
    """Return the runs of a file, without CAVs. Raises InputError for a damaged file and for one of another version."""
    infos, rows = _read_table(path, (SCHEMA, LOAD_SCHEMA, SENT_SCHEMA), RunInfo)
    scenarios: dict[tuple[str, int], list[ScenarioResult]] = {}
    for row in rows:
        with _report_faults(path):
            scenarios.setdefault((row["part"], row["run"]), []).append(_make_result(row))
    values: dict[str, list[Results]] = {}
    for (part, number), members in scenarios.items():
        found = summarize_run(infos[number], members)  # without messages, of which the labels follow
        values.setdefault(part, []).append(found.model_copy(update={"run": infos[number]}))
    return values


def read_opened(path: Path) -> Sequence[OpenLoopResults]:
    """Return the open loop of the runs of a file, none if there is none. Raises InputError as `read_values`."""
    path = name_open_file(path)
    if not path.is_file():
        return ()
    infos, rows = _read_table(path, (OPEN_SCHEMA,), OpenLoopRunInfo)
    scenarios: dict[int, list[OpenLoopScenario]] = {}
    for row in rows:
        with _report_faults(path):
            facts = {name: value for name, value in row.items() if name not in ("run", "agent")} | OPEN_LEFT_OUT
            counts = {"precision_counts": json.loads(row["precision_counts"])}
            scenarios.setdefault(row["run"], []).append(OpenLoopScenario.model_validate(facts | counts))
    found = {number: summarize_open_loop(infos[number], members) for number, members in scenarios.items()}
    return [results.model_copy(update={"run": infos[number]}) for number, results in found.items()]


@contextmanager
def _report_faults(path: Path) -> Generator[None]:
    try:
        yield
    except (ValueError, ValidationError) as error:
        raise InputError(f"{path}: expected runs and scores of this version: {error}") from None


def _read_table(
    path: Path, schemas: Sequence[Any], kind: type[InfoT]
) -> tuple[Sequence[InfoT], Sequence[dict[str, Any]]]:
    """Return the settings of the runs of a file, and its rows; schemas: those it may have, the usual one first."""
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
    if not any(table.schema.equals(schema) for schema in schemas):
        raise InputError(
            f"{path}: expected the columns {', '.join(schemas[0].names)}, found {', '.join(table.schema.names)}"
        )
    rows = table.to_pylist()
    with _report_faults(path):
        infos = [kind.model_validate(run) for run in json.loads(about.get("runs", "[]"))]
    if outside := [row["run"] for row in rows if not 0 <= row["run"] < len(infos)]:
        raise InputError(f"{path}: run: expected one of {len(infos)} runs, found number {outside[0]}")
    return infos, rows


def _make_result(row: dict[str, Any]) -> ScenarioResult:
    facts = {name: row[name] for name in ("seed", *TEXTS, *SCORES)} | LEFT_OUT
    if row.get("bytes_s") is not None:
        facts["sent_rates"] = {ALL_TYPES: {name: row[name] for name in ("messages_s", "bytes_s")}}
    if row.get("busy_mean") is not None:
        facts["busy_ratio"] = {"mean": row["busy_mean"], "greatest": row["busy_greatest"]}
    if row.get(SENT_RATE) is not None:
        facts["scalars"] = {SENT_RATE: row[SENT_RATE]}
    return ScenarioResult.model_validate(facts)
