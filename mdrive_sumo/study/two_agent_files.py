"""The studies of two agents as files: JSON with all numbers, CSV for tables, Markdown to read."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, ConfidenceInterval
from mdrive_sumo.core.tables import (
    Column,
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
    make_text_table,
)
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.study.cross_play import CrossPlaySummary
from mdrive_sumo.study.penetration import PenetrationSummary
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
from mdrive_sumo.study.two_agents import DS, METRICS, ROLES, TwoAgentRow

CROSS_PLAY_FORMAT, PENETRATION_FORMAT = "mdrive-sumo/cross-play/1", "mdrive-sumo/penetration/1"
BRACKETS = f"""\
{METHOD_NOTE} Differences are paired by scenario and seed; an interval that contains 0 shows no difference.
{TOO_FEW_NOTE}"""
CROSS_PLAY = f"""\
Each agent drives one CAV of every scenario, drawn by the seed, among CAVs of another agent. Numbers are DS and SR of
that CAV [%]. A row is the agent under test, a column the agent of the others. "With strangers" is the mean over the
columns of all other agents: how well the agent does with partners that it was not built for. {BRACKETS}"""
PENETRATION = f"""\
Only a share of the CAVs drives as the agent, drawn by the seed; the others drive as the second agent. With the same
seed a higher penetration keeps the CAVs of a lower one. Numbers are means over scenarios of means over the CAVs of a
role [%], each scored alone; a role counts over the scenarios that have such CAVs. {BRACKETS}"""


def cross_play_json(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: CrossPlaySummary) -> str:
    """Return all numbers as JSON."""
    page = _describe(CROSS_PLAY_FORMAT, about, rows) | {
        "agents": list(summary.agents),
        "scenarios": summary.scenarios,
        "void": summary.void,
        "cells": [
            {"agent": tested, "others": others} | _to_dict(intervals)
            for (tested, others), intervals in summary.cells.items()
        ],
        "with_strangers": {agent: _to_dict(intervals) for agent, intervals in summary.with_strangers.items()},
        "loss": {agent: _to_dict(intervals) for agent, intervals in summary.loss.items()},
    }
    return dump_page(page)


def penetration_json(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: PenetrationSummary) -> str:
    """Return all numbers as JSON."""
    lines = [
        {"agent": line.agent, "penetration": line.penetration, "scenarios": line.scenarios}
        | {"score": {role: _to_dict(intervals) for role, intervals in line.score.items()}}
        | {"difference": _to_dict(line.difference)}
        for line in summary.lines
    ]
    page = _describe(PENETRATION_FORMAT, about, rows) | {"void": summary.void, "lines": lines}
    return dump_page(page)


def cross_play_csv(summary: CrossPlaySummary) -> str:
    """Return one line for each pair and metric."""
    rows = (
        (*pair, metric, *format_csv_interval(intervals[metric]))
        for pair, intervals in summary.cells.items()
        for metric in METRICS
    )
    return format_csv(make_text_table(("agent", "others", "metric", "mean", "low", "high"), rows))


def penetration_csv(summary: PenetrationSummary) -> str:
    """Return one line for each agent, penetration, role and metric."""
    rows = (
        (line.agent, str(line.penetration), role, metric, *format_csv_interval(intervals[metric]))
        for line in summary.lines
        for role, intervals in line.score.items()
        for metric in METRICS
    )
    return format_csv(make_text_table(("agent", "penetration", "role", "metric", "mean", "low", "high"), rows))


def cross_play_markdown(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: CrossPlaySummary) -> str:
    """Return the study as a page."""
    title = f"# {read_stored_name(about.suite)}: agents among CAVs of other agents"
    tables = (
        "## With strangers",
        format_markdown(build_strangers_table(summary)),
        count_by_chance(summary.loss.values()),
        "## All pairs, DS",
        format_markdown(build_matrix(summary)),
    )
    return join_paragraphs((title, list_study_facts(about, rows[0].results[0].run, summary.void), CROSS_PLAY, *tables))


def penetration_markdown(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: PenetrationSummary) -> str:
    """Return the study as a page."""
    title = f"# {read_stored_name(about.suite)}: a share of the CAVs connected"
    table = format_markdown(build_penetration_table(summary))
    counted = count_by_chance(line.difference for line in summary.lines if line.penetration)
    facts = list_study_facts(about, rows[0].results[0].run, summary.void)
    return join_paragraphs((title, facts, PENETRATION, table, counted))


def build_strangers_table(summary: CrossPlaySummary) -> Table:
    """Return a row for each agent, the best with strangers first."""
    columns = (
        Column("agent", "agent"),
        *(make_interval_column(metric, f"{metric.upper()} with strangers") for metric in METRICS),
        *(
            make_interval_column(f"{metric}_loss", f"{metric.upper()} - with its own", has_sign=True)
            for metric in METRICS
        ),
    )
    rows = [
        make_row(
            (
                agent,
                *(make_interval_cell(summary.with_strangers[agent][metric]) for metric in METRICS),
                *(make_interval_cell(summary.loss[agent][metric]) for metric in METRICS),
            )
        )
        for agent in sorted(summary.agents, key=lambda agent: -summary.with_strangers[agent][DS].mean)
    ]
    return Table("strangers", "With strangers", columns, tuple(rows))


def build_matrix(summary: CrossPlaySummary) -> Table:
    """Return the mean DS of every pair."""
    columns = (
        Column("tested", "under test"),
        *(Column(agent, f"among {agent}", decimals=1) for agent in summary.agents),
    )
    rows = [
        make_row((tested, *(summary.cells[tested, others][DS].mean for others in summary.agents)))
        for tested in summary.agents
    ]
    return Table("pairs", "All pairs, DS", columns, tuple(rows))


def build_penetration_table(summary: PenetrationSummary) -> Table:
    """Return a row for each agent, penetration and role; differences stand in the rows of all CAVs."""
    columns = (
        *make_text_columns({"agent": "agent", "penetration": "penetration", "role": "role"}),
        *(make_interval_column(metric, metric.upper()) for metric in METRICS),
        *(make_interval_column(f"{metric}_difference", f"{metric.upper()} - 0 %", has_sign=True) for metric in METRICS),
    )
    rows = [
        make_row(
            (
                line.agent,
                f"{line.penetration} %",
                role,
                *(make_interval_cell(line.score[role][metric]) for metric in METRICS),
                *(make_interval_cell(line.difference[metric] if role == ROLES[0] else None) for metric in METRICS),
            )
        )
        for line in summary.lines
        for role in ROLES
        if role in line.score
    ]
    return Table("penetration", "A share of the CAVs connected", columns, tuple(rows))


def _describe(name: str, about: StudyDescription, rows: Sequence[TwoAgentRow]) -> dict[str, Any]:
    return describe_study(name, about, rows[0].results[0].run) | {
        "rows": [
            {"agent": row.agent, "others": row.others, "penetration": row.penetration}
            | {"runs": [run_to_dict(results) for results in row.results]}
            for row in rows
        ],
    }


def _to_dict(intervals: Mapping[str, ConfidenceInterval]) -> dict[str, Any]:
    return {metric: asdict(interval) for metric, interval in intervals.items()}
