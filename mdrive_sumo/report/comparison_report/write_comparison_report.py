"""Write a comparison report: page, Markdown, tables as LaTeX and CSV, figures as SVG and PNG.

`report.html` is one self-contained page without scripts, light and dark, also on a phone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from markupsafe import Markup

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.clean_text import clean_for_markdown
from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.core.tables import (
    MARKS_LEGEND,
    Cell,
    Column,
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
)
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport, ReportSection
from mdrive_sumo.report.comparison_report.replay_pages import describe_replays, find_replay_links
from mdrive_sumo.report.comparison_report.report_figures import inline_svg, pick_shade
from mdrive_sumo.report.comparison_report.scenario_tables import find_ds_class
from mdrive_sumo.report.html_page import PAGE_TEMPLATES, read_static
from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.report.table_latex import format_latex, format_latex_document

TEMPLATE, STYLE = "comparison_report.html", "comparison_report.css"
SHADES = 6
"""Classes of shaded cells: those of `scenario_tables.DS_CLASSES`, and full scores."""
MAX_OPEN_ROWS = 60
"""Longer tables are folded."""
PAGE_FILE, MARKDOWN_FILE = "report.html", "report.md"
CSV_FOLDER, LATEX_FOLDER, FIGURES_FOLDER = "csv", "latex", "figures"
LATEX_DOCUMENT = "all_tables"
MAX_LATEX_ROWS = 60
"""Longer tables do not fit on a page: they have no LaTeX file."""


@dataclass(frozen=True, slots=True)
class ReportLinks:
    """Links of a page: to its tables in other formats, by the name of a table, and to replays."""

    csv: dict[str, str]
    latex: dict[str, str]
    replays: dict[Path, str] = field(default_factory=dict[Path, str])
    """Links to the replays that exist, by their pages; "" for a page that none leads to."""


def render_report_page(report: ComparisonReport, images: dict[str, bytes], links: ReportLinks | None = None) -> str:
    """Return the page. images: the figures as SVG by name. links: if the page is written beside other files."""
    page_links = links or ReportLinks({}, {})
    shades = "".join(
        f".shade-{i} {{ background: {pick_shade(i, SHADES)}; color: {'#111' if i >= SHADES // 2 else '#fff'}; }}\n"
        for i in range(SHADES)
    )
    style = format_custom_properties() + read_static(STYLE) + shades
    return PAGE_TEMPLATES.get_template(TEMPLATE).render(
        report=report,
        style=Markup(style),
        links=page_links,
        replays_notes={table.name: describe_replays(table, links.replays) for table in report.tables} if links else {},
        images={figure.name: Markup(inline_svg(images[figure.name], figure.name)) for figure in report.figures},
        list_classes=_list_classes,
        max_open_rows=MAX_OPEN_ROWS,
        is_any_marked=any(table.has_marks for table in report.tables),
    )


def _list_classes(cell: Cell, column: Column, table: Table) -> Sequence[str]:
    """Return the classes of a cell: its rank, and its shade in a shaded table."""
    classes = [f"rank-{cell.rank}"] if cell.rank else []
    is_score = table.is_shaded and cell.number is not None and column.decimals
    return [*classes, *([f"shade-{find_ds_class(cell.number)}"] if is_score and cell.number is not None else [])]


def write_comparison_report(report: ComparisonReport, out: Path) -> tuple[Path, ...]:
    """Write a report into a new or empty folder, completely or not at all; return the files to begin with.

    Raises InputError if the folder holds something or cannot be written.
    """
    contents = render_report_files(report, PAGE_FILE, MARKDOWN_FILE, out)
    with atomic_folder(out) as draft:
        for name, content in contents.items():
            make_parents(draft / name)
            write_bytes(draft / name, content)
    return out / PAGE_FILE, out / MARKDOWN_FILE, out / LATEX_FOLDER, out / CSV_FOLDER, out / FIGURES_FOLDER


def render_report_files(report: ComparisonReport, page_file: str, markdown_file: str, folder: Path) -> dict[str, bytes]:
    """Return the content of every file of a report by its path: the two pages, tables and figures.

    folder: where they will lie; the page has links from there to the replays that exist.
    """
    images = {figure.name: figure.render("png", "svg") for figure in report.figures}
    latex = [table for table in report.tables if len(table.rows) <= MAX_LATEX_ROWS]
    links = ReportLinks(
        {table.name: f"{CSV_FOLDER}/{table.name}.csv" for table in report.tables},
        {table.name: f"{LATEX_FOLDER}/{table.name}.tex" for table in latex},
        find_replay_links(report.tables, folder),
    )
    texts = {
        page_file: render_report_page(report, {name: svg for name, (_, svg) in images.items()}, links),
        markdown_file: format_report_markdown(report),
        **{links.csv[table.name]: format_csv(table) for table in report.tables},
        **{links.latex[table.name]: format_latex(table) for table in latex},
        f"{LATEX_FOLDER}/{LATEX_DOCUMENT}.tex": format_latex_document(
            tuple(table.name for table in latex), report.title
        ),
    }
    pictures = {
        f"{FIGURES_FOLDER}/{name}.{kind}": content
        for name, (png, svg) in images.items()
        for kind, content in (("png", png), ("svg", svg))
    }
    return {**{name: text.encode("utf-8") for name, text in texts.items()}, **pictures}


def format_report_markdown(report: ComparisonReport) -> str:
    """Return the report as a Markdown page; its figures lie in the folder `figures` beside it."""
    parts = [f"# {clean_for_markdown(report.title)}"]
    parts.append(
        "\n".join(f"- {clean_for_markdown(name)}: {clean_for_markdown(value)}" for name, value in report.facts.items())
    )
    if report.warnings:
        parts.append("\n".join(f"- **Note:** {clean_for_markdown(warning)}" for warning in report.warnings))
    if any(table.has_marks for table in report.tables):
        parts.append(MARKS_LEGEND)
    for section in report.sections:
        parts += _format_section(section)
    return join_paragraphs(parts)


def _format_section(section: ReportSection) -> list[str]:
    points = [
        f"- **{clean_for_markdown(name)}**: {clean_for_markdown(words)}" for name, words in section.points.items()
    ]
    parts = [f"## {clean_for_markdown(section.title)}", "\n".join(points), clean_for_markdown(section.note)]
    parts += [
        f"![{clean_for_markdown(figure.title)}]({FIGURES_FOLDER}/{figure.name}.png)" for figure in section.figures
    ]
    for table in section.tables:
        parts += [f"### {clean_for_markdown(table.title)}", format_markdown(table), clean_for_markdown(table.note)]
    return parts
