"""Compare a run's `report.md` with the report that its results give."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.tree_difference import ABSENT
from mdrive_sumo.report.result_tables import CAPTURED_COLUMN
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.scoring import Results

FIGURE_MARKS = ("|", "- ", "#", "No ")
"""What a line with figures or facts begins with; others are prose, which changes from version to version."""
MAX_CHARACTERS = 160


def has_captured_cooperation(text: str) -> bool:
    """Return whether a report has the columns of `--captured`, which depend on other runs."""
    return CAPTURED_COLUMN.label in text


def find_report_differences(expected: Results, text: str) -> Iterator[str]:
    """Yield a sentence for every line with figures that is not as the results give it.

    Columns of captured cooperation are left out: see `has_captured_cooperation`.
    """
    right = _list_figures(build_run_report(expected))
    for (_, line), (number, found) in zip_longest(right, _list_figures(text), fillvalue=(0, ABSENT)):
        if line != found:
            place = f"line {number}" if number else "end"
            yield f"{place}: expected {truncate(line, MAX_CHARACTERS)}, found {truncate(found, MAX_CHARACTERS)}"


def _list_figures(text: str) -> Sequence[tuple[int, str]]:
    """Return number and content of the lines with figures."""
    lines: list[tuple[int, str]] = []
    is_captured = False
    for number, line in enumerate(text.splitlines(), start=1):
        is_captured = CAPTURED_COLUMN.label in line or (is_captured and line.startswith("|"))
        if line.startswith(FIGURE_MARKS):
            lines.append((number, line.rsplit("|", 2)[0].rstrip() + " |" if is_captured else line))
    return lines
