"""The files of the study beside its runs: pages, tables, figures and `paper.json`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.report.comparison_report.write_comparison_report import render_report_files
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.study.paper.paper_facts import PaperRequest
from mdrive_sumo.study.paper.paper_json import build_paper_json
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_report import build_paper_report

PAGE_FILE, MARKDOWN_FILE, JSON_FILE = "paper.html", "paper.md", "paper.json"


def write_paper(
    folder: Path, numbers: PaperNumbers, request: PaperRequest, about: Mapping[str, Any]
) -> tuple[Path, ...]:
    """Write all files of a finished study and return the pages. about: the content of `study_plan.json`.

    Raises InputError if that is not possible.
    """
    contents = render_report_files(build_paper_report(numbers, request), PAGE_FILE, MARKDOWN_FILE, folder)
    contents[JSON_FILE] = build_paper_json(numbers, request, about).encode()
    for name, content in contents.items():
        path = folder / name
        with report_write_errors(path):
            make_parents(path)
            write_bytes(path, content)
    return tuple(folder / name for name in (PAGE_FILE, MARKDOWN_FILE, JSON_FILE))
