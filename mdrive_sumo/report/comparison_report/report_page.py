"""`report.html`: a comparison report as one self-contained page without scripts, light and dark, also on a phone."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from markupsafe import Markup

from mdrive_sumo.core.tables import (
    Cell,
    Column,
    Table,
)
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport
from mdrive_sumo.report.comparison_report.replay_pages import describe_replays
from mdrive_sumo.report.comparison_report.report_figure import ReportFigure, inline_svg
from mdrive_sumo.report.comparison_report.report_figures import pick_shade
from mdrive_sumo.report.comparison_report.scenario_tables import find_ds_class
from mdrive_sumo.report.html_page import PAGE_TEMPLATES, read_static
from mdrive_sumo.report.palette import format_custom_properties

TEMPLATE, STYLE = "comparison_report.html", "comparison_report.css"
SHADES = 6
MAX_OPEN_ROWS = 60
"""Longer tables are folded."""


@dataclass(frozen=True, slots=True)
class ReportLinks:
    """Links of a page: to its tables in other formats, by the name of a table, and to replays."""

    csv: dict[str, str]
    latex: dict[str, str]
    replays: dict[Path, str] = field(default_factory=dict[Path, str])
    """Links to the replays that exist, by their pages; "" for a page that none leads to."""


def render_report_page(report: ComparisonReport, images: dict[str, bytes], links: ReportLinks | None = None) -> str:
    """Return the page. images: the figures as SVG by name. links: if the page is written beside other files."""
    known = links or ReportLinks({}, {})
    shades = "".join(
        f".shade-{i} {{ background: {pick_shade(i, SHADES)}; color: {'#111' if i >= SHADES // 2 else '#fff'}; }}\n"
        for i in range(SHADES)
    )
    style = format_custom_properties() + read_static(STYLE) + shades
    return PAGE_TEMPLATES.get_template(TEMPLATE).render(
        report=report,
        style=Markup(style),
        links=known,
        replays_notes={table.name: describe_replays(table, links.replays) for table in report.tables} if links else {},
        images={figure.name: _inline(figure, images) for figure in report.figures},
        list_classes=_list_classes,
        max_open_rows=MAX_OPEN_ROWS,
        is_any_marked=any(table.has_marks for table in report.tables),
    )


def _inline(figure: ReportFigure, images: dict[str, bytes]) -> Markup:
    return Markup(inline_svg(images[figure.name], figure.name))


def _list_classes(cell: Cell, column: Column, table: Table) -> Sequence[str]:
    """Return the classes of a cell: its rank, and its shade in a shaded table."""
    classes = [f"rank-{cell.rank}"] if cell.rank else []
    is_score = table.is_shaded and cell.number is not None and column.decimals
    return [*classes, *([f"shade-{find_ds_class(cell.number)}"] if is_score and cell.number is not None else [])]
