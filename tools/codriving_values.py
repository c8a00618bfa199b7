"""What messages are worth to CoDriving: against its twins without any, and DS over what a CAV sends.

    python -m tools.codriving_values NAME STEM

draws the curve of the budgets in docs/results/values/NAME.parquet into STEM.png and STEM.svg.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes

from mdrive_sumo.agents.learned.fusion_spec import MAP_TICKS
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import METHOD_NOTE, ConfidenceInterval, describe_comparisons
from mdrive_sumo.core.tables import Column, Row, Table, format_markdown, make_row, make_text_columns
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.comparison_report.compared_agent import pool_results
from mdrive_sumo.report.figure_style import COLOURS, open_figure, save_figure
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    bootstrap_results,
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
    list_results,
)
from mdrive_sumo.study.occlusion_certificate import OcclusionCertificateFile
from mdrive_sumo.study.study_files import make_interval_cell, make_interval_column
from tools.published_values import BUDGET_PART, SENT_RATE, VALUES_FOLDER, Values, read_values
from tools.tool_command import HELP, ToolCommand

PAIRS = (("codriving", "codriving:alone"), ("codriving:fast", "codriving:fast-alone"))
"""Agents and their twins without messages."""
ALONE = "alone"
"""Part of the twin that neither sends nor reads messages."""
LEAST_BUDGETS = 2
"""A curve needs two points."""
SIZE_IN = 7.0, 4.2


def list_message_gains(runs: Sequence[Results]) -> Sequence[str]:
    """Return the paragraphs of the table of agents and their twins, with and without certificates of occlusion.

    Raises InputError for twins that were not driven, and for runs of one agent with several options.
    """
    found = {agent: _pool(agent, runs) for pair in PAIRS for agent in pair}
    pairs = [(ours, twin) for ours, twin in PAIRS if found[ours] is not None and found[twin] is not None]
    if not pairs:
        raise InputError(f"table message-gain: expected runs of {' and '.join(PAIRS[0])}, found no such pair")
    suite = load_suite(runs[0].run.suite_label)
    file = OcclusionCertificateFile.load(suite)
    certified = {one.id for one in suite.scenarios if one.id in file and file[one.id].occluded}
    groups: Mapping[str, Callable[[str], bool]] = {
        "all": lambda _: True,
        "with an occlusion certificate": lambda name: name in certified,
        "without one": lambda name: name not in certified,
    }
    columns = (
        *make_text_columns({"agent": "agent", "group": "scenarios"}),
        Column("count", "number", decimals=0),
        make_interval_column("ds", "DS"),
        make_interval_column("twin", "DS without messages"),
        make_interval_column("gain", "difference", has_sign=True),
    )
    rows: list[Row] = []
    gains: list[ConfidenceInterval | None] = []
    for ours, twin in pairs:
        for group, is_member in groups.items():
            tables = with_messages, without = [_select(found[agent], is_member) for agent in (ours, twin)]
            gains.append(compute_difference_interval(with_messages, without, "ds"))
            scores = (compute_score_interval(table, "ds") for table in tables)
            rows.append(make_row((ours, group, float(len(tables[0])), *map(make_interval_cell, (*scores, gains[-1])))))
    return format_markdown(Table("message_gain", "", columns, tuple(rows), left=2)), describe_comparisons(gains)


def _pool(agent: str, runs: Sequence[Results]) -> Results | None:
    """Return the runs of an agent, which differ in seeds alone, as one; None without any."""
    found = [results for results in runs if results.run.agent == agent]
    if len({results.run.agent_config for results in found}) > 1:
        raise InputError(f"table message-gain: expected {agent} with the same options in all runs, found others")
    return pool_results(found) if found else None


def _select(results: Results | None, is_member: Callable[[str], bool]) -> ResultTable:
    table = {} if results is None else group_by_scenario(results.scenarios)
    return {name: by_seed for name, by_seed in table.items() if is_member(name)}


@dataclass(frozen=True, slots=True)
class BudgetLine:
    """CoDriving with one budget, over the scenarios that all runs have."""

    budget: int
    """[bytes] Of a map and its request."""
    sent_kbit_s: ConfidenceInterval | None
    """Of one CAV: payloads of all its messages. None: not known."""
    ds: ConfidenceInterval | None
    gain: ConfidenceInterval | None
    """DS beyond that of the twin; None without its runs."""

    @property
    def most_kbit_s(self) -> float:
        """What the budget allows."""
        return self.budget * 8 * TICKS_PER_SECOND / MAP_TICKS / 1000


@dataclass(frozen=True, slots=True)
class BudgetCurve:
    """All budgets, the least first."""

    scenarios: int
    lines: tuple[BudgetLine, ...]
    alone: ConfidenceInterval | None
    """DS of the twin without messages; None without its runs."""


def measure_budgets(values: Values) -> BudgetCurve:
    """Return what each budget has.

    Raises InputError for fewer than two budgets, and for runs without common scenarios.
    """
    budgets = sorted(int(found[1]) for part in values if (found := re.fullmatch(BUDGET_PART, part)))
    if len(budgets) < LEAST_BUDGETS:
        raise InputError(f"table budgets: expected runs of {LEAST_BUDGETS} budgets or more, found {len(budgets)}")
    tables = {part: group_by_scenario(pool_results(found).scenarios) for part, found in values.items()}
    first = next(iter(tables.values()))
    common = sorted(name for name in first if all(name in table for table in tables.values()))
    if not common:
        raise InputError("table budgets: expected scenarios that all runs have, found none")
    kept = {part: {name: table[name] for name in common} for part, table in tables.items()}
    alone = kept.get(ALONE)
    lines = tuple(_make_line(budget, kept[f"budget-{budget}"], alone) for budget in budgets)
    return BudgetCurve(len(common), lines, None if alone is None else compute_score_interval(alone, "ds"))


def _make_line(budget: int, table: ResultTable, alone: ResultTable | None) -> BudgetLine:
    results = list_results(table)
    sent = [one.scalars.get(SENT_RATE) for one in results]
    is_known = all(value is not None for value in sent)
    return BudgetLine(
        budget,
        bootstrap_results(np.array(sent, dtype=float), results) if is_known else None,
        compute_score_interval(table, "ds"),
        None if alone is None else compute_difference_interval(table, alone, "ds"),
    )


def list_budget_table(values: Values) -> Sequence[str]:
    """Return the paragraphs of the table. Raises InputError as `measure_budgets`."""
    curve = measure_budgets(values)
    columns = (
        Column("budget", "budget [bytes]", decimals=0),
        Column("most", "allows [kbit/s]", decimals=0),
        make_interval_column("sent", "a CAV sends [kbit/s]"),
        make_interval_column("ds", "DS"),
        make_interval_column("gain", "DS - DS without messages", has_sign=True),
    )
    rows = [
        make_row(
            (
                float(line.budget),
                line.most_kbit_s,
                *map(make_interval_cell, (line.sent_kbit_s, line.ds, line.gain)),
            )
        )
        for line in curve.lines
    ]
    runs = [results.run for found in values.values() for results in found]
    suites = ", ".join(dict.fromkeys(run.suite_label for run in runs))
    seeds = sorted({seed for run in runs for seed in run.all_seeds})
    alone = "" if curve.alone is None else f" Without messages DS is {curve.alone.mean:.1f}."
    return (
        f"Measured on the {curve.scenarios} scenarios that all runs have (of {suites}), seeds:"
        f" {', '.join(map(str, seeds))}. A CAV sends payloads of all its messages, CAMs included.{alone} {METHOD_NOTE}",
        format_markdown(Table("budgets", "", columns, tuple(rows))),
        describe_comparisons([line.gain for line in curve.lines]),
    )


def _draw(axes: Axes, curve: BudgetCurve) -> None:
    lines = [line for line in curve.lines if line.ds is not None]
    x = [line.most_kbit_s if line.sent_kbit_s is None else line.sent_kbit_s.mean for line in lines]
    y = np.array([line.ds.mean for line in lines if line.ds is not None])
    ends = [(line.ds and line.ds.ends) or (line.ds.mean, line.ds.mean) for line in lines if line.ds is not None]
    bars = np.abs(np.array(ends).T - y)
    axes.errorbar(x, y, yerr=bars, color=COLOURS[0], marker="o", capsize=3, label="codriving")
    for line, place, height in zip(lines, x, y, strict=True):
        axes.annotate(f"{line.budget} bytes", (place, height), textcoords="offset points", xytext=(6, -12), fontsize=8)
    if curve.alone is not None:
        axes.axhline(curve.alone.mean, color=COLOURS[1], linestyle="--", label="without messages")
        if curve.alone.ends is not None:
            axes.axhspan(*curve.alone.ends, color=COLOURS[1], alpha=0.12)
    axes.set_xscale("log")
    axes.set(xlabel="a CAV sends [kbit/s]", ylabel="DS [%]")
    axes.legend(frameon=False)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("name")
@click.argument("stem", type=click.Path(path_type=Path))
def main(name: str, stem: Path) -> None:
    """Draw DS against kbit/s of the values NAME into STEM.png and STEM.svg."""
    curve = measure_budgets(read_values(VALUES_FOLDER / f"{name}.parquet"))
    with open_figure(*SIZE_IN) as figure:
        _draw(figure.add_subplot(), curve)
        for path in save_figure(figure, stem):
            echo(str(path))


if __name__ == "__main__":
    main()
