"""The results of a channel study as files: `study.json` with all numbers, `study.md` to read."""

import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mdrive_sumo.core.statistics import (
    METHOD_NOTE,
    TOO_FEW_NOTE,
    ConfidenceInterval,
    Verdict,
    describe_comparisons,
    judge_intervals,
)
from mdrive_sumo.core.tables import (
    Cell,
    CellValue,
    Column,
    IntervalStyle,
    Table,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
)
from mdrive_sumo.report.result_tables import CAPTURED_COLUMN, describe_agent, list_percent
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.scoring import Means, Results, RunInfo
from mdrive_sumo.study.study_summary import StudyLine
from mdrive_sumo.v2x.comm_settings import describe_comm

FORMAT = "mdrive-sumo/study/1"
INTERVALS = ("ds", "sr", "efficient_sr", "time_ratio", "ds_difference", "sr_difference", "captured")
GRID_TEXT = {
    "one-at-a-time": "one factor at a time is changed, the others are the base channel's",
    "full": "all combinations of the factors' values",
}
HOW_TO_READ = f"""\
DS and SR are means over scenarios and seeds in percent. {METHOD_NOTE} `DS - base` and `SR - base` are
the differences to the same agent over the base channel, paired by scenario and seed: an interval without 0
tells an effect. `off` is the agent with the channel switched off. Scenarios that are void with any seed are
left out. Efficient SR counts the successes within 2 x `omniscient`'s time; the time ratio is the time needed
divided by `omniscient`'s, over the scenarios in which every CAV arrives with every seed (`timed`). An agent that
sends no messages (*) is driven over the base channel only: no channel can change it. {TOO_FEW_NOTE}"""
LOADS = """\
kB/s is what all stations together send at ETSI's rates, without headers, a message to many counting once;
the busy ratio is the share of the time in which the channel of a radio is busy at the CAVs."""
CAPTURED = """\
Captured cooperation is (agent - agent with the channel off) / (omniscient - agent with the channel off), on
the scenario mean of DS; blank where perfect cooperation gains less than 2 DS."""


@dataclass(frozen=True, slots=True)
class StudyDescription:
    """The study as the user asked for it."""

    suite: str
    scenario: str
    grid: str
    factors: Mapping[str, Sequence[Sequence[float]]]
    seeds: Sequence[int]
    command: Sequence[str]


def study_json(about: StudyDescription, lines: Sequence[StudyLine]) -> str:
    """Return all numbers as JSON; each line holds seed, scores, minimum TTC and channel counts of its runs."""
    run = lines[0].row.results[0].run
    page = {
        "format": FORMAT,
        **asdict(about),
        "suite_checksum": run.suite_checksum,
        "score_mode": run.score_mode,
        "agent_clock": run.agent_clock,
        "versions": run.versions,
        "lines": [_line_to_dict(line) for line in lines],
    }
    return dump_page(page)


def dump_page(page: Mapping[str, Any]) -> str:
    """Return the numbers of a study as the text of a JSON file."""
    return json.dumps(page, indent=1, allow_nan=False) + "\n"


def judge_by_metric(lines: Sequence[Mapping[str, ConfidenceInterval]]) -> dict[str, tuple[Verdict, ...]]:
    """Return what differences show by metric, in the order of the lines, corrected for their number by metric."""
    return {metric: judge_intervals([line[metric] for line in lines]) for metric in lines[0]}


def count_by_chance(lines: Iterable[Mapping[str, ConfidenceInterval]]) -> str:
    """Return by metric how many differences of a table exclude 0, and how many are left by `judge_by_metric`."""
    rows = [*lines]
    counted = {metric: describe_comparisons([row[metric] for row in rows]) for row in rows[:1] for metric in row}
    return " ".join(f"{metric.upper()}: {text}" for metric, text in counted.items() if text)


def _line_to_dict(line: StudyLine) -> dict[str, Any]:
    row = line.row
    numbers = {name: getattr(line, name) for name in INTERVALS}
    return {
        "agent": row.agent,
        "labels": row.results[0].run.labels,
        "sensing_track": row.results[0].run.sensing_track,
        "condition": row.condition.name,
        "levels": dict(row.condition.levels),
        "comm": describe_comm(row.condition.comm),
        "reused": row.reused,
        "void": line.void,
        "timed": line.timed,
        **{name: value for name in ("bytes_s", "busy_ratio") if (value := getattr(line, name)) is not None},
        **{name: None if value is None else asdict(value) for name, value in numbers.items()},
        "runs": [run_to_dict(results) for results in row.results],
    }


def describe_study(format_name: str, about: StudyDescription, run: RunInfo) -> dict[str, Any]:
    """Return what the JSON of a study of agents begins with: format, question, and settings of its first run."""
    return {
        "format": format_name,
        "suite": about.suite,
        "scenario": about.scenario,
        "seeds": list(about.seeds),
        "command": list(about.command),
        "suite_checksum": run.suite_checksum,
        "score_mode": run.score_mode,
        "comm": run.comm,
        "versions": run.versions,
    }


def list_study_facts(about: StudyDescription, run: RunInfo, void: int) -> str:
    """Return the facts above the tables of a study of agents, as a Markdown list."""
    return format_facts(
        {
            "suite": f"{read_stored_name(about.suite)}, checksum `{run.suite_checksum}`, scenarios `{about.scenario}`",
            "left out as void": str(void),
            "seeds": ", ".join(map(str, about.seeds)),
            "channel": ", ".join(f"{name} {value}" for name, value in run.comm.items()),
            **_list_origin(about, run),
        }
    )


def _list_origin(about: StudyDescription, run: RunInfo) -> dict[str, str]:
    return {
        "command": f"`{shlex.join(about.command)}`",
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }


def format_facts(facts: Mapping[str, str]) -> str:
    """Return a Markdown list of names and values."""
    return "\n".join(f"- {name}: {value}" for name, value in facts.items())


def run_to_dict(results: Results) -> dict[str, Any]:
    """Return the scores, digests and channel counts of a run."""
    kept = {"status", "reason", *Means.model_fields, "min_ttc", "scalars", "digest", "comm", "notes"}
    return {
        "seed": results.run.seed,
        "overall": results.overall.model_dump(),
        "scenarios": {scenario.id: scenario.model_dump(mode="json", include=kept) for scenario in results.scenarios},
    }


def study_markdown(about: StudyDescription, lines: Sequence[StudyLine], pictures: Sequence[Path]) -> str:
    """Return the study as a page: facts, how to read it, the table, and the plots beside it."""
    parts = (
        f"# {read_stored_name(about.suite)}: the channel and what it does",
        _format_facts(about, lines),
        HOW_TO_READ,
        CAPTURED if _has_captured(lines) else "",
        LOADS if _has_loads(lines) else "",
        format_markdown(build_study_table(lines)),
        describe_comparisons([one for line in lines for one in (line.ds_difference, line.sr_difference)]),
        *(f"![{picture.stem}]({picture.name})" for picture in pictures),
    )
    return join_paragraphs(parts)


def _format_facts(about: StudyDescription, lines: Sequence[StudyLine]) -> str:
    run = lines[0].row.results[0].run
    channel = ", ".join(f"{name} {value}" for name, value in describe_comm(lines[0].row.condition.comm).items())
    facts = {
        "suite": f"{read_stored_name(about.suite)}, checksum `{run.suite_checksum}`, scenarios `{about.scenario}`,"
        f" {len(lines[0].row.results[0].scenarios)} of them",
        "seeds": ", ".join(map(str, about.seeds)),
        "conditions": GRID_TEXT[about.grid],
        "base channel": channel,
        "agent clock": run.agent_clock,
        "score mode": run.score_mode,
        **_list_origin(about, run),
    }
    return format_facts(facts)


def build_study_table(lines: Sequence[StudyLine], *, brief: bool = False) -> Table:
    """Return a row for each line. brief: for the terminal, with intervals of DS only."""
    columns = (
        *make_text_columns({"agent": "agent", "condition": "condition"}),
        make_interval_column("ds", "DS"),
        make_interval_column("sr", "SR"),
        make_interval_column("efficient_sr", "efficient SR"),
        make_interval_column("time_ratio", "time ratio", decimals=2),
        Column("timed", "timed", decimals=0),
        make_interval_column("ds_difference", "DS - base", has_sign=True),
        make_interval_column("sr_difference", "SR - base", has_sign=True),
        Column("void", "void", decimals=0),
        CAPTURED_COLUMN,
        Column("kb_s", "kB/s", undefined=""),
        Column("busy_ratio", "busy ratio", decimals=3, undefined=""),
    )
    hidden = {
        *(("timed", "sr_difference") if brief else ()),
        *(() if _has_captured(lines) else (CAPTURED_COLUMN.key,)),
        *(() if _has_loads(lines) else ("kb_s", "busy_ratio")),
    }
    shown = [i for i, column in enumerate(columns) if column.key not in hidden]
    cells = [_list_cells(line, brief=brief) for line in lines]
    rows = [make_row([row[i] for i in shown]) for row in cells]
    return Table("study", "The channel and what it does", tuple(columns[i] for i in shown), tuple(rows), left=2)


def _list_cells(line: StudyLine, *, brief: bool) -> list[CellValue | Cell]:
    """Return the cells of all columns; brief: with intervals of DS only."""
    intervals = {name: getattr(line, name) for name in INTERVALS if name != "captured"}
    cells = {
        name: Cell(value.mean if value else None, None if brief and not name.startswith("ds") else value)
        for name, value in intervals.items()
    }
    return [
        line.row.agent if brief else describe_agent(line.row.results[0]),
        line.row.condition.name + (" *" if line.row.reused else ""),
        *(cells[name] for name in ("ds", "sr", "efficient_sr", "time_ratio")),
        line.timed,
        *(cells[name] for name in ("ds_difference", "sr_difference")),
        line.void,
        *list_percent([line.captured.scenario_mean if line.captured else None]),
        None if line.bytes_s is None else line.bytes_s / 1000.0,
        line.busy_ratio,
    ]


def _has_captured(lines: Sequence[StudyLine]) -> bool:
    return any(line.captured for line in lines)


def _has_loads(lines: Sequence[StudyLine]) -> bool:
    return any(line.bytes_s is not None or line.busy_ratio is not None for line in lines)


def make_interval_column(key: str, label: str, *, has_sign: bool = False, decimals: int = 1) -> Column:
    """Return a column of means with both ends in brackets, empty where undefined. has_sign: of differences."""
    return Column(key, label, decimals=decimals, has_sign=has_sign, intervals=IntervalStyle.ENDS, undefined="")


def make_interval_cell(interval: ConfidenceInterval | None) -> Cell:
    """Return the cell of a mean with its interval."""
    return Cell(interval.mean if interval else None, interval)


def format_csv_interval(value: ConfidenceInterval) -> tuple[str, str, str]:
    """Return mean, low and high end for a CSV file; no ends for too few scenarios."""
    low, high = (f"{end:.6f}" for end in value.ends) if value.ends else ("", "")
    return f"{value.mean:.6f}", low, high
