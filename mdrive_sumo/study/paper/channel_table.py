"""Tables of worse channels (RQ5): the clean channel, the perturbed one, and their paired difference."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.statistics import TOO_FEW_NOTE
from mdrive_sumo.core.tables import (
    Cell,
    CellValue,
    Column,
    IntervalStyle,
    Row,
    Table,
    make_row,
)
from mdrive_sumo.report.published_results import AS_PUBLISHED, PublishedDegradation
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
)
from mdrive_sumo.study.conditions import ChannelCondition
from mdrive_sumo.study.study_runs import StudyRow

SCORES: Mapping[str, tuple[str, int]] = {"ds": ("DS", 2), "rc": ("RC", 2), "ip": ("IS", 3), "sr": ("SR", 2)}
"""Scores of the paper's tables with their decimals; its IS is the infraction penalty IP."""
INTERVALS = ("ds", "sr")
"""Scores whose differences are shown with an interval: the table shall fit a page."""


def build_channel_table(
    name: str,
    title: str,
    rows: Sequence[StudyRow],
    conditions: tuple[ChannelCondition, ChannelCondition],
    published: Sequence[PublishedDegradation],
) -> Table:
    """Return the table of one perturbation for every agent that has both rows.

    conditions: the clean one and the perturbed one. Differences are paired by scenario and seed; scenarios that are
    void in one of the two are left out of both.
    """
    clean, perturbed = conditions
    by_key = {(row.agent, row.condition.name): row for row in rows}
    agents = [row.agent for row in rows if row.condition.name == clean.name]
    ours = [
        _build_row(agent, by_key[agent, clean.name], by_key[agent, perturbed.name])
        for agent in agents
        if (agent, perturbed.name) in by_key
    ]
    return Table(name, title, _make_columns(), (*ours, *map(_build_published_row, published)), note=_describe(ours))


def _make_columns() -> tuple[Column, ...]:
    columns = [Column("agent", "agent")]
    for score, (label, decimals) in SCORES.items():
        columns += [
            Column(f"{score}_clean", "clean", label, decimals),
            Column(f"{score}_perturbed", "perturbed", label, decimals),
            Column(f"{score}_difference", "Δ", label, decimals, has_sign=True, intervals=IntervalStyle.ENDS),
        ]
    return tuple(columns)


def _build_row(agent: str, clean: StudyRow, perturbed: StudyRow) -> Row:
    tables = [group_by_scenario(row.scenarios) for row in (clean, perturbed)]
    first, second = (_select_common(table, tables) for table in tables)
    cells: list[CellValue | Cell] = [agent]
    for score in SCORES:
        means = [compute_score_interval(table, score) for table in (first, second)]
        difference = compute_difference_interval(second, first, score)
        cells += [None if mean is None else mean.mean for mean in means]
        has_interval = score in INTERVALS
        cells.append(Cell(None) if difference is None else Cell(difference.mean, difference if has_interval else None))
    return make_row(cells, "mdrive-sumo")


def _select_common(table: ResultTable, tables: Sequence[ResultTable]) -> ResultTable:
    return {name: found for name, found in table.items() if all(name in other for other in tables)}


def _build_published_row(published: PublishedDegradation) -> Row:
    cells: list[CellValue] = [published.method]
    for score in SCORES:
        clean, perturbed = getattr(published, score)
        cells += [clean, perturbed, perturbed - clean]
    return make_row(cells, AS_PUBLISHED, is_ranked=False)


def _describe(ours: Sequence[Row]) -> str:
    if not ours:
        return "No agent of this study exchanges messages."
    return (
        "Brackets: 95 % bootstrap interval of the difference, paired by scenario and seed; one that contains 0 shows no"
        f" effect. {TOO_FEW_NOTE} Published differences are those of the printed scores; the"
        " paper prints some that deviate by 0.01."
    )
