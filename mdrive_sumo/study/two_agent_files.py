"""The studies of two agents as files: JSON with all numbers, CSV for tables, Markdown to read."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from mdrive_sumo.core.statistics import TOO_FEW_NOTE, ConfidenceInterval
from mdrive_sumo.core.tables import TableRow, format_csv_table, format_markdown_table
from mdrive_sumo.study.cross_play import CrossPlaySummary
from mdrive_sumo.study.penetration import PenetrationSummary
from mdrive_sumo.study.study_files import (
    StudyDescription,
    describe_study,
    format_csv_interval,
    format_interval,
    list_study_facts,
    run_to_dict,
)
from mdrive_sumo.study.two_agents import DS, METRICS, ROLES, TwoAgentRow

CROSS_PLAY_FORMAT, PENETRATION_FORMAT = "mdrive-sumo/cross-play/1", "mdrive-sumo/penetration/1"
STRANGERS_HEADER = ("agent", "DS with strangers", "SR with strangers", "DS - with its own", "SR - with its own")
PENETRATION_HEADER = ("agent", "penetration", "role", "DS", "SR", "DS - 0 %", "SR - 0 %")
BRACKETS = f"""\
In brackets are 95 % bootstrap confidence intervals: scenarios are drawn anew, with more than one seed also the seeds
within each. Differences are paired by scenario and seed; an interval that contains 0 shows no difference.
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
            {"agent": tested, "others": others} | _to_dict(found) for (tested, others), found in summary.cells.items()
        ],
        "with_strangers": {agent: _to_dict(found) for agent, found in summary.with_strangers.items()},
        "loss": {agent: _to_dict(found) for agent, found in summary.loss.items()},
    }
    return json.dumps(page, indent=1, allow_nan=False) + "\n"


def penetration_json(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: PenetrationSummary) -> str:
    """Return all numbers as JSON."""
    lines = [
        {"agent": line.agent, "penetration": line.penetration, "scenarios": line.scenarios}
        | {"score": {role: _to_dict(found) for role, found in line.score.items()}}
        | {"difference": _to_dict(line.difference)}
        for line in summary.lines
    ]
    page = _describe(PENETRATION_FORMAT, about, rows) | {"void": summary.void, "lines": lines}
    return json.dumps(page, indent=1, allow_nan=False) + "\n"


def cross_play_csv(summary: CrossPlaySummary) -> str:
    """Return one line for each pair and metric."""
    rows = (
        (*pair, metric, *format_csv_interval(found[metric]))
        for pair, found in summary.cells.items()
        for metric in METRICS
    )
    return format_csv_table(("agent", "others", "metric", "mean", "low", "high"), rows)


def penetration_csv(summary: PenetrationSummary) -> str:
    """Return one line for each agent, penetration, role and metric."""
    rows = (
        (line.agent, str(line.penetration), role, metric, *format_csv_interval(found[metric]))
        for line in summary.lines
        for role, found in line.score.items()
        for metric in METRICS
    )
    return format_csv_table(("agent", "penetration", "role", "metric", "mean", "low", "high"), rows)


def cross_play_markdown(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: CrossPlaySummary) -> str:
    """Return the study as a page."""
    title = f"# {about.suite}: agents among CAVs of other agents"
    tables = (
        "## With strangers",
        format_markdown_table(STRANGERS_HEADER, make_strangers_table(summary), left=1),
        "## All pairs, DS",
        format_markdown_table(*make_matrix(summary), left=1),
    )
    return _join((title, list_study_facts(about, rows[0].results[0].run, summary.void), CROSS_PLAY, *tables))


def penetration_markdown(about: StudyDescription, rows: Sequence[TwoAgentRow], summary: PenetrationSummary) -> str:
    """Return the study as a page."""
    title = f"# {about.suite}: a share of the CAVs connected"
    table = format_markdown_table(PENETRATION_HEADER, make_penetration_table(summary), left=3)
    return _join((title, list_study_facts(about, rows[0].results[0].run, summary.void), PENETRATION, table))


def make_strangers_table(summary: CrossPlaySummary) -> list[TableRow]:
    """Return a row for each agent, the best with strangers first."""
    order = sorted(summary.agents, key=lambda agent: -summary.with_strangers[agent][DS].mean)
    return [
        (
            agent,
            *(format_interval(summary.with_strangers[agent][metric]) for metric in METRICS),
            *(format_interval(summary.loss[agent][metric], "+") for metric in METRICS),
        )
        for agent in order
    ]


def make_matrix(summary: CrossPlaySummary) -> tuple[TableRow, list[TableRow]]:
    """Return header and rows of the mean DS of every pair."""
    header = ("under test", *(f"among {agent}" for agent in summary.agents))
    return header, [
        (tested, *(f"{summary.cells[tested, others][DS].mean:.1f}" for others in summary.agents))
        for tested in summary.agents
    ]


def make_penetration_table(summary: PenetrationSummary) -> list[TableRow]:
    """Return a row for each agent, penetration and role; differences stand in the rows of all CAVs."""
    return [
        (
            line.agent,
            f"{line.penetration} %",
            role,
            *(format_interval(line.score[role][metric]) for metric in METRICS),
            *(format_interval(line.difference[metric], "+") if role == ROLES[0] else "" for metric in METRICS),
        )
        for line in summary.lines
        for role in ROLES
        if role in line.score
    ]


def _describe(name: str, about: StudyDescription, rows: Sequence[TwoAgentRow]) -> dict[str, Any]:
    return describe_study(name, about, rows[0].results[0].run) | {
        "rows": [
            {"agent": row.agent, "others": row.others, "penetration": row.penetration}
            | {"runs": [run_to_dict(one) for one in row.results]}
            for row in rows
        ],
    }


def _to_dict(found: Mapping[str, ConfidenceInterval]) -> dict[str, Any]:
    return {metric: asdict(interval) for metric, interval in found.items()}


def _join(parts: Sequence[str]) -> str:
    return "\n\n".join(parts) + "\n"
