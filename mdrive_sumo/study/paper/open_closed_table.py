"""Tables and figure of open loop against closed loop (RQ3)."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE
from mdrive_sumo.core.tables import (
    BestValue,
    Column,
    IntervalStyle,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.report_figures import ReportFigure
from mdrive_sumo.report.figure_style import COLOURS, MARKERS
from mdrive_sumo.study.paper.open_closed import OPEN_METRICS, OpenClosedComparison, OpenClosedLine
from mdrive_sumo.study.study_files import make_interval_cell

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


def build_open_closed_table(comparison: OpenClosedComparison) -> Table:
    """Return the metrics of every agent in both loops."""
    columns = (
        Column("agent", "agent"),
        *(Column(metric, METRIC_LABELS[metric], "open loop", best=_choose_best(metric)) for metric in OPEN_METRICS),
        *(Column(score, label, "closed loop", best=BestValue.HIGHEST) for score, label in SCORE_LABELS.items()),
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
    return Table("open_closed", "Open loop and closed loop", columns, tuple(rows), note).mark_columns()


def _choose_best(metric: str) -> BestValue:
    return BestValue.HIGHEST if OPEN_METRICS[metric] > 0 else BestValue.LOWEST


def build_correlation_table(comparison: OpenClosedComparison) -> Table:
    """Return the rank correlations of open-loop metrics with closed-loop scores."""
    ends = IntervalStyle.ENDS
    columns = (
        Column("metric", "open loop"),
        Column("score", "closed loop"),
        Column("agents", "agents", decimals=0),
        Column("spearman", "Spearman ρ", has_sign=True, intervals=ends),
        Column("kendall", "Kendall τ", has_sign=True, intervals=ends),
    )
    rows = [
        make_row(
            (
                METRIC_LABELS[correlation.metric][:-2],
                correlation.score.upper(),
                float(len(correlation.agents)),
                *(make_interval_cell(interval) for interval in (correlation.spearman, correlation.kendall)),
            )
        )
        for correlation in comparison.correlations
    ]
    note = (
        "+1: the agents have the same order in both loops, best first; 0: open loop does not tell; -1: the reverse."
        f" {METHOD_NOTE} The agents stay the same. {TOO_FEW_NOTE}"
        " -: too few agents, or all tied."
    )
    return Table("rank_correlation", "Rank correlation of open and closed loop", columns, tuple(rows), note)


def make_open_closed_figure(comparison: OpenClosedComparison) -> ReportFigure:
    """Return the paper's figure: AP50 and ADE against DS and SR."""

    def draw(figure: Figure) -> None:
        panels = [(score, metric) for score in SCORE_LABELS for metric in FIGURE_METRICS]
        for place, (score, metric) in enumerate(panels, start=1):
            _draw_panel(figure.add_subplot(2, 2, place), comparison.lines, metric, score)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)

    described = "; ".join(
        f"{line.agent}: {', '.join(f'{metric} {getattr(line.open, metric)}' for metric in FIGURE_METRICS)},"
        f" DS {line.ds:.1f}, SR {line.sr:.1f}"
        for line in comparison.lines
    )
    title = f"Open loop against closed loop (scenarios: {comparison.scenarios})"
    return ReportFigure("open_closed_figure", title, described, (9.0, 7.6), draw)


def _draw_panel(axes: Axes, lines: Sequence[OpenClosedLine], metric: str, score: str) -> None:
    for place, line in enumerate(lines):
        value = getattr(line.open, metric)
        is_known = value is not None
        axes.scatter(
            [value] if is_known else [],
            [getattr(line, score)] if is_known else [],
            color=COLOURS[place % len(COLOURS)],
            marker=MARKERS[place % len(MARKERS)],
            facecolors="none" if line.is_reference else None,
            s=45,
            label=line.agent,
        )
    axes.set(xlabel=METRIC_LABELS[metric], ylabel=SCORE_LABELS[score])
