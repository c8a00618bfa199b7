"""The study of attacks as files: `attacks.json` with all numbers, `attacks.csv` for tables, `attacks.md` to read."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, ConfidenceInterval
from mdrive_sumo.core.tables import (
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
    make_text_table,
)
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.study.attacks import METRICS, AttackLine, AttackRow, AttackSummary
from mdrive_sumo.study.study_files import (
    StudyDescription,
    count_by_chance,
    describe_study,
    dump_page,
    format_csv_interval,
    list_study_facts,
    make_interval_cell,
    make_interval_column,
    run_to_dict,
)

FORMAT = "mdrive-sumo/attacks/1"
DIFFERENCES = ("to_alone", "to_honest", "to_undefended")
HOW_TO_READ = f"""\
DS is a mean over scenarios and seeds and all CAVs, the attacker included, in percent; differences are points of DS,
paired by scenario and seed: to the first agent, which reads no messages; to the same agent among honest senders; and of
an agent with its defence to the same without it. {METHOD_NOTE} An interval that contains 0 shows no difference, neither
a loss nor that there is none. {TOO_FEW_NOTE}"""


def attacks_json(about: StudyDescription, rows: Sequence[AttackRow], summary: AttackSummary) -> str:
    """Return all numbers as JSON."""
    page = describe_study(FORMAT, about, rows[0].results[0].run) | {
        "scenarios": summary.scenarios,
        "void": summary.void,
        "lines": [
            {"agent": line.agent, "defence": line.has_defence, "attack": line.attack, "score": _to_dict(line.score)}
            | {name: _to_dict(getattr(line, name)) for name in DIFFERENCES}
            for line in summary.lines
        ],
        "rows": [
            {"agent": row.agent, "defence": row.has_defence, "attack": row.attack}
            | {"runs": [run_to_dict(results) for results in row.results]}
            for row in rows
        ],
    }
    return dump_page(page)


def attacks_csv(summary: AttackSummary) -> str:
    """Return one line for each row, metric and quantity: the score, and the differences that it has."""
    rows = (
        (line.agent, _name_defence(line), line.attack, quantity, metric, *format_csv_interval(intervals[metric]))
        for line in summary.lines
        for quantity in ("score", *DIFFERENCES)
        if (intervals := getattr(line, quantity)) is not None
        for metric in METRICS
    )
    columns = ("agent", "defence", "attack", "quantity", "metric", "mean", "low", "high")
    return format_csv(make_text_table(columns, rows))


def attacks_markdown(about: StudyDescription, rows: Sequence[AttackRow], summary: AttackSummary) -> str:
    """Return the study as a page."""
    parts = (
        f"# {read_stored_name(about.suite)}: senders that lie",
        list_study_facts(about, rows[0].results[0].run, summary.void),
        HOW_TO_READ,
        format_markdown(build_attacks_table(summary)),
        count_by_chance({"ds": line.to_alone["ds"]} for line in summary.lines if line.to_alone is not None),
    )
    return join_paragraphs(parts)


def build_attacks_table(summary: AttackSummary) -> Table:
    """Return a row for each agent, defence and attack."""
    alone = summary.lines[0].agent
    columns = (
        *make_text_columns({"agent": "agent", "defence": "defence", "attack": "attack"}),
        make_interval_column("ds", "DS"),
        make_interval_column("to_alone", f"- {alone}", has_sign=True),
        make_interval_column("to_honest", "- honest", has_sign=True),
        make_interval_column("to_undefended", "- undefended", has_sign=True),
    )
    rows = [
        make_row(
            (
                line.agent,
                _name_defence(line),
                line.attack,
                make_interval_cell(line.score["ds"]),
                *(make_interval_cell(_get_ds(getattr(line, name))) for name in DIFFERENCES),
            )
        )
        for line in summary.lines
    ]
    return Table("attacks", "Senders that lie", columns, tuple(rows))


def _name_defence(line: AttackLine) -> str:
    return {None: "-", True: "on", False: "off"}[line.has_defence]


def _get_ds(intervals: Mapping[str, ConfidenceInterval] | None) -> ConfidenceInterval | None:
    return None if intervals is None else intervals["ds"]


def _to_dict(intervals: Mapping[str, ConfidenceInterval] | None) -> dict[str, Any] | None:
    return None if intervals is None else {metric: asdict(interval) for metric, interval in intervals.items()}
