"""Tables and figure of RQ4: persons, scripted drivers and agents in the same CAVs of the same scenarios."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, judge_intervals
from mdrive_sumo.core.tables import Cell, Column, IntervalStyle, Row, Table, make_row, make_text_columns
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport, ReportSection
from mdrive_sumo.report.comparison_report.report_figures import HATCHES, ReportFigure
from mdrive_sumo.report.figure_style import COLOURS
from mdrive_sumo.study.human.human_results import (
    CavScore,
    HumanDrive,
    HumanStudyResults,
    compute_gap,
    compute_mean_interval,
)
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.scripted_driver import DRIVER_KINDS
from mdrive_sumo.study.study_files import make_interval_cell

NO_PERSON = "no person has driven"
"""What stands in the row of persons until a person has driven."""
PERSONS_SECTION = "persons"
SCRIPTED_SECTION = "scripted drivers: programs, not persons"
AGENTS_SECTION = "agents"
ALL_CONDITIONS = "all"
SCORE_COLUMNS: Mapping[str, tuple[str, int]] = {
    "ds": ("DS [%]", 2),
    "sr": ("SR [%]", 2),
    "rc": ("RC [%]", 2),
    "ip": ("IS", 3),
    "time_s": ("time [s]", 1),
    "time_ratio": ("time ratio", 3),
}
INTERVALS = ("ds", "sr", "time_ratio")
"""Scores that are shown with an interval: the table shall fit a page."""
FIGURE_SCORES: Mapping[str, str] = {"ds": "DS [%]", "sr": "SR [%]", "rc": "RC [%]"}
WIDTH_IN, HEIGHT_IN = 9.0, 4.2
NOTE = (
    "Scores of the CAV that a participant drives, and of the same CAV in the runs of agents, where the agent drives all"
    " CAVs. SR: share of the drives with a DS above the threshold of success. Time: until the goal, over the drives"
    " that reach it; time ratio: to `omniscient`'s. ±: half of the 95 % interval of a nested bootstrap over"
    f" places, scenarios and the drives of each; it says nothing about other participants. {TOO_FEW_NOTE}"
)


@dataclass(frozen=True, slots=True)
class DriverGroup:
    """Drives that share a row."""

    name: str
    condition: str
    section: str
    scores: tuple[CavScore, ...]
    participants: int | None
    """None for agents."""
    interventions: float | None
    """Mean changes between participant and agent in a drive; None for agents."""

    @property
    def label(self) -> str:
        """Name and condition in one text."""
        return self.name if self.condition in ("", ALL_CONDITIONS) else f"{self.name}, {self.condition}"


def list_groups(results: HumanStudyResults) -> tuple[DriverGroup, ...]:
    """Return persons first, then each kind of scripted driver, each by condition and over all, then agents."""
    groups = [*_split(results.plan, "persons", PERSONS_SECTION, results.persons)]
    for driver in dict.fromkeys(drive.driver for drive in results.scripted):
        drives = [drive for drive in results.scripted if drive.driver == driver]
        groups += _split(results.plan, driver, SCRIPTED_SECTION, drives)
    groups += [DriverGroup(name, "", AGENTS_SECTION, scores, None, None) for name, scores in results.agents.items()]
    return tuple(groups)


def _split(plan: HumanStudyPlan, name: str, section: str, drives: Sequence[HumanDrive]) -> Iterator[DriverGroup]:
    conditions = [condition.name for condition in plan.conditions]
    parts = {condition: [drive for drive in drives if drive.condition == condition] for condition in conditions}
    if len(conditions) > 1:
        parts[ALL_CONDITIONS] = [*drives]
    for condition, members in parts.items():
        if members:
            yield DriverGroup(
                name,
                condition,
                section,
                tuple(drive.score for drive in members),
                len({drive.code for drive in members}),
                sum(drive.interventions for drive in members) / len(members),
            )


def build_human_table(results: HumanStudyResults) -> Table:
    """Return the table of RQ4; without a drive of a person, the row of persons says so."""
    columns = (
        *make_text_columns({"driver": "driver", "condition": "condition"}),
        Column("participants", "participants", decimals=0),
        Column("drives", "drives", decimals=0),
        Column("scenarios", "scenarios", decimals=0),
        *(Column(key, label, decimals=decimals) for key, (label, decimals) in SCORE_COLUMNS.items()),
        Column("interventions", "per drive", "interventions"),
    )
    groups = list_groups(results)
    rows = [_make_row(group) for group in groups]
    if not results.persons:
        empty = make_row(("persons", NO_PERSON, *[None] * (len(columns) - 2)), PERSONS_SECTION)
        rows.insert(0, empty)
    return Table("rq4", "Persons, scripted drivers and agents (RQ4)", columns, tuple(rows), NOTE, left=2)


def _make_row(group: DriverGroup) -> Row:
    cells: list[Cell | str | float | None] = [
        group.name,
        group.condition or "-",
        None if group.participants is None else float(group.participants),
        float(len(group.scores)),
        float(len({score.scenario for score in group.scores})),
    ]
    for name in SCORE_COLUMNS:
        interval = compute_mean_interval(group.scores, name)
        cells.append(make_interval_cell(interval) if name in INTERVALS else Cell(interval.mean if interval else None))
    return make_row((*cells, group.interventions), group.section)


def build_gap_to_humans(results: HumanStudyResults) -> Table | None:
    """Return what each agent loses or gains against each kind of driver over all conditions; None without both."""
    bases = [
        group
        for group in list_groups(results)
        if group.section != AGENTS_SECTION and (group.condition == ALL_CONDITIONS or len(results.plan.conditions) == 1)
    ]
    if not bases or not results.agents:
        return None
    ends = IntervalStyle.ENDS
    columns = (
        *make_text_columns({"agent": "agent", "base": "minus"}),
        Column("ds", "DS", "difference", has_sign=True, intervals=ends),
        Column("sr", "SR", "difference", has_sign=True, intervals=ends),
        Column("time_ratio", "time ratio", "difference", decimals=3, has_sign=True, intervals=ends),
        *make_text_columns({"shown_ds": "shown by DS", "shown_sr": "shown by SR"}),
    )
    pairs = [(base, agent) for base in bases for agent in results.agents]
    gaps = {
        name: [compute_gap(results.agents[agent], base.scores, name) for base, agent in pairs]
        for name in ("ds", "sr", "time_ratio")
    }
    verdicts = {name: iter(judge_intervals([gap for gap in gaps[name] if gap])) for name in ("ds", "sr")}
    rows = [
        make_row(
            (
                agent,
                base.name,
                *(make_interval_cell(gaps[name][i]) for name in gaps),
                *(str(next(shown)) if gaps[name][i] else "-" for name, shown in verdicts.items()),
            ),
            PERSONS_SECTION if base.section == PERSONS_SECTION else SCRIPTED_SECTION,
        )
        for i, (base, agent) in enumerate(pairs)
    ]
    note = (
        "Differences paired by scenario; a participant's drives of a scenario count as their mean. A time ratio counts"
        f" where both reach the goal. {METHOD_NOTE} {TOO_FEW_NOTE}"
    )
    return Table("rq4_gap", "Agents minus drivers (RQ4)", columns, tuple(rows), note, left=2)


def make_human_figure(results: HumanStudyResults) -> ReportFigure:
    """Return the counterpart of part (a) of the paper's figure: scores of every kind of driver, in bars."""
    groups = [
        group
        for group in list_groups(results)
        if group.section == AGENTS_SECTION or group.condition == ALL_CONDITIONS or len(results.plan.conditions) == 1
    ]
    described = "; ".join(
        f"{group.name}: " + ", ".join(f"{label} {_find_mean(group, name):.1f}" for name, label in FIGURE_SCORES.items())
        for group in groups
    )
    title = (
        "Scores of persons, scripted drivers and agents"
        if results.persons
        else (f"Scores of scripted drivers and agents ({NO_PERSON})")
    )

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(3, 1.2))
        _draw_scores(left, groups)
        _draw_ratios(right, groups)
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)

    return ReportFigure("rq4_figure", title, described, (WIDTH_IN, HEIGHT_IN + 0.25 * (len(groups) // 4)), draw)


def _find_mean(group: DriverGroup, name: str) -> float:
    interval = compute_mean_interval(group.scores, name)
    return float("nan") if interval is None else interval.mean


def _draw_scores(axes: Axes, groups: Sequence[DriverGroup]) -> None:
    width = 0.84 / max(len(groups), 1)
    for i, group in enumerate(groups):
        x = np.arange(len(FIGURE_SCORES)) - 0.42 + width * (i + 0.5)
        heights = [_find_mean(group, name) for name in FIGURE_SCORES]
        colour, hatch = COLOURS[i % len(COLOURS)], HATCHES[i // len(COLOURS) % len(HATCHES)]
        axes.bar(x, heights, width * 0.92, label=group.name, color=colour, hatch=hatch, edgecolor="none")
        for name, place, height in zip(FIGURE_SCORES, x, heights, strict=True):
            interval = compute_mean_interval(group.scores, name)
            if interval is not None and interval.ends is not None:
                low, high = interval.ends
                axes.errorbar(place, height, [[height - low], [high - height]], color="#000000", linewidth=0.8)
    axes.set_xticks(range(len(FIGURE_SCORES)), [*FIGURE_SCORES.values()])
    axes.set(ylim=(0, 108))
    axes.grid(axis="x", visible=False)


def _draw_ratios(axes: Axes, groups: Sequence[DriverGroup]) -> None:
    for i, group in enumerate(groups):
        colour, hatch = COLOURS[i % len(COLOURS)], HATCHES[i // len(COLOURS) % len(HATCHES)]
        axes.bar(i, _find_mean(group, "time_ratio"), 0.8, color=colour, hatch=hatch, edgecolor="none")
    axes.set_xticks([])
    axes.set(xlabel="time ratio to omniscient")
    axes.grid(axis="x", visible=False)


def build_rq4_parts(results: HumanStudyResults) -> tuple[tuple[Table, ...], tuple[ReportFigure, ...]]:
    """Return tables and figures of RQ4, for the study's own report and for that of the paper."""
    gap = build_gap_to_humans(results)
    tables = (build_human_table(results), *((gap,) if gap else ()))
    return tables, (make_human_figure(results),) if results.drives or results.agents else ()


def build_human_report(results: HumanStudyResults, command: str) -> ComparisonReport:
    """Return the report of a study. command: with which it was written."""
    plan = results.plan
    tables, figures = build_rq4_parts(results)
    kinds = [name for name in DRIVER_KINDS if any(drive.driver.endswith(name) for drive in results.scripted)]
    facts = {
        "study": plan.title,
        "persons": str(len({drive.code for drive in results.persons})) if results.persons else NO_PERSON,
        **({"scripted drivers": f"{', '.join(kinds)}: programs, which count as no person"} if kinds else {}),
        "withdrawn": str(results.withdrawn),
        "suite": f"{plan.suite_name}, seed {plan.seed}",
        "scenarios": ", ".join(scenario.id for scenario in plan.scenarios),
        "conditions": "; ".join(
            f"{condition.name}: V2X view {'on' if condition.v2x_view else 'off'}, chat"
            f" {'on' if condition.chat else 'off'}, partner {condition.partner}"
            for condition in plan.conditions
        ),
        "order": plan.order,
        "command": command,
    }
    warnings = () if results.persons else (f"{NO_PERSON}: nothing here says anything about people.",)
    section = ReportSection("Human drivers (RQ4)", tables, figures, points=RQ4_POINTS)
    return ComparisonReport(f"Human study: {plan.title}", facts, warnings, (section,))


RQ4_POINTS = {
    "Counterpart of": "fig:mdrive_human_experiments",
    "The paper": "CoLMDriver succeeds less often than human experts, and is slower when it negotiates.",
}
