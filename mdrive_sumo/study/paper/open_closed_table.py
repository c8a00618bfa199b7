"""Tables and figure of open loop against closed loop (RQ3)."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from mdrive_sumo.report.comparison_report.report_table import (
    BestValue,
    IntervalStyle,
    ReportCell,
    ReportColumn,
    ReportTable,
    make_row,
)
from mdrive_sumo.report.figure_style import COLOURS, MARKERS, open_figure, save_figure
from mdrive_sumo.study.paper.open_closed import OPEN_METRICS, OpenClosedComparison, OpenClosedLine

METRIC_LABELS = {
    "ap50": "AP50 [%] ↑",
    "ade": "ADE [m] ↓",
    "fde": "FDE [m] ↓",
    "cr": "CR [%] ↓",
    "cr_mdrive": "CR mdrive [%] ↓",
    "overlap": "overlap [%] ↓",
}
SCORE_LABELS = {"ds": "DS [%] ↑", "sr": "SR [%] ↑"}
FIGURE_METRICS = ("ap50", "ade")
"""Open-loop axes of the paper's figure (fig:mdrive_olcl_correlation)."""


def build_open_closed_table(comparison: OpenClosedComparison) -> ReportTable:
    """Return the metrics of every agent in both loops."""
    columns = (
        ReportColumn("agent", "agent"),
        *(
            ReportColumn(metric, METRIC_LABELS[metric], "open loop", best=_choose_best(metric))
            for metric in OPEN_METRICS
        ),
        *(ReportColumn(score, label, "closed loop", best=BestValue.HIGHEST) for score, label in SCORE_LABELS.items()),
    )
    rows = [
        make_row(
            (line.agent, *(getattr(line.open, metric) for metric in OPEN_METRICS), line.ds, line.sr),
            "reference: compared with its own drives, not ranked" if line.is_reference else "",
            is_ranked=not line.is_reference,
        )
        for line in comparison.lines
    ]
    note = (
        f"The same {comparison.scenarios} scenarios in both loops."
        " -: the agent replies no plan of 3 s, or no detections."
    )
    return ReportTable("open_closed", "Open loop and closed loop", columns, tuple(rows), note).mark_columns()


def _choose_best(metric: str) -> BestValue:
    return BestValue.HIGHEST if OPEN_METRICS[metric] > 0 else BestValue.LOWEST


def build_correlation_table(comparison: OpenClosedComparison) -> ReportTable:
    """Return the rank correlations of open-loop metrics with closed-loop scores."""
    ends = IntervalStyle.ENDS
    columns = (
        ReportColumn("metric", "open loop"),
        ReportColumn("score", "closed loop"),
        ReportColumn("agents", "agents", decimals=0),
        ReportColumn("spearman", "Spearman ρ", has_sign=True, intervals=ends),
        ReportColumn("kendall", "Kendall τ", has_sign=True, intervals=ends),
    )
    rows = [
        make_row(
            (
                METRIC_LABELS[one.metric][:-2],
                one.score.upper(),
                float(len(one.agents)),
                *(
                    ReportCell(None) if found is None else ReportCell(found.mean, found)
                    for found in (one.spearman, one.kendall)
                ),
            )
        )
        for one in comparison.correlations
    ]
    note = (
        "+1: the agents have the same order in both loops, best first; 0: open loop does not tell; -1: the reverse."
        " Brackets: 95 % bootstrap intervals over scenarios; the agents stay the same. -: too few agents, or all tied."
    )
    return ReportTable("rank_correlation", "Rank correlation of open and closed loop", columns, tuple(rows), note)


def draw_open_closed(comparison: OpenClosedComparison, title: str, stem: Path) -> tuple[Path, Path]:
    """Write the paper's figure, AP50 and ADE against DS and SR, as STEM.png and STEM.svg. Raises InputError."""
    with open_figure(9.0, 7.0) as figure:
        for row, score in enumerate(SCORE_LABELS):
            for column, metric in enumerate(FIGURE_METRICS):
                axes = figure.add_subplot(2, 2, 2 * row + column + 1)
                _draw_panel(axes, comparison.lines, metric, score)
        figure.suptitle(title, fontsize="medium")
        handles, labels = figure.axes[1].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize="small")
        return save_figure(figure, stem)


def _draw_panel(axes: Axes, lines: Sequence[OpenClosedLine], metric: str, score: str) -> None:
    for place, line in enumerate(lines):
        value = getattr(line.open, metric)
        known = value is not None
        axes.scatter(
            [value] if known else [],
            [getattr(line, score)] if known else [],
            color=COLOURS[place % len(COLOURS)],
            marker=MARKERS[place % len(MARKERS)],
            facecolors="none" if line.is_reference else None,
            s=45,
            label=line.agent,
        )
    axes.set(xlabel=METRIC_LABELS[metric], ylabel=SCORE_LABELS[score])
