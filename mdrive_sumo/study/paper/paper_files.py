"""The files of the study beside its runs: pages, tables, figures and `paper.json`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mdrive_sumo.report.comparison_report.table_csv import format_csv
from mdrive_sumo.report.comparison_report.table_latex import format_latex, format_latex_document
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.study.paper.open_closed_table import draw_open_closed
from mdrive_sumo.study.paper.paper_json import build_paper_json
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_page import TITLE, PaperRequest, build_markdown_page
from mdrive_sumo.study.paper.paper_sections import (
    CATEGORY_FIGURE,
    OPEN_CLOSED_FIGURE,
    QUICK,
    PaperSection,
    build_sections,
)

PAGES = ("paper.md", "paper.html", "paper.tex", "paper.json")


def write_paper(folder: Path, numbers: PaperNumbers, request: PaperRequest, about: Mapping[str, Any]) -> list[Path]:
    """Write all files of a finished study and return the pages. about: the content of `study_plan.json`.

    Raises InputError if that is not possible.
    """
    sections = build_sections(numbers)
    tables = [table for section in sections for table in section.tables]
    _draw_figures(folder, numbers, sections)
    texts = {f"{table.name}.csv": format_csv(table) for table in tables}
    texts |= {f"{table.name}.tex": format_latex(table) for table in tables}
    texts["paper.md"] = build_markdown_page(numbers, sections, request)
    texts["paper.tex"] = format_latex_document(tuple(table.name for table in tables), TITLE)
    texts["paper.json"] = build_paper_json(numbers, request, about)
    for name, text in texts.items():
        with report_write_errors(folder / name):
            (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in PAGES if name in texts]


def _draw_figures(folder: Path, numbers: PaperNumbers, sections: Sequence[PaperSection]) -> None:
    mark = f"{QUICK}: " if numbers.plan.quick else ""
    for stem in (figure for section in sections for figure in section.figures):
        if stem.endswith(OPEN_CLOSED_FIGURE):
            title = f"{mark}open loop against closed loop, {numbers.comparison.scenarios} scenarios"
            draw_open_closed(numbers.comparison, title, folder / stem)
        elif stem.endswith(CATEGORY_FIGURE):
            pass
