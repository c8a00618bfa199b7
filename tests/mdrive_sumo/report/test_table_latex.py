"""LaTeX tables: escaping, columns that fit the layout, marks; compiled where LaTeX is installed."""

import re
import shutil
import string
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.report_samples import make_sample_runs

from mdrive_sumo.core.tables import BestValue, Column, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.comparison_report import build_comparison_report
from mdrive_sumo.report.comparison_report.score_tables import build_main_table
from mdrive_sumo.report.published_results import PUBLISHED_METHODS
from mdrive_sumo.report.table_latex import (
    PACKAGES,
    escape_latex,
    format_latex,
    format_latex_document,
)

SPECIAL = set("\\{}$&#_%~^")


@given(st.text(string.printable + "±×✓°–Δ≤名é\u2028", max_size=40))
def test_no_special_character_stays_active(text: str) -> None:
    found = escape_latex(text)
    assert found.isascii() and "\n" not in found
    rest = re.sub(r"\\text[a-z]+\{\}|\\checkmark\{\}|\$(\^)?\\[A-Za-z]+\$|\\[{}$&#_%]|\{[\[\]*]\}", "", found)
    assert not SPECIAL & set(rest), found


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("ins_c & 5 %", r"ins\_c \& 5 \%"),
        (r"\input{x}", r"\textbackslash{}input\{x\}"),
        ("1 ± 2 ✓ ×", r"1 $\pm$ 2 \checkmark{} $\times$"),
        ("[1, 2]*", "{[}1, 2{]}{*}"),
        ("名", "?"),
    ],
)
def test_text_is_printed_as_it_is(text: str, escaped: str) -> None:
    assert escape_latex(text) == escaped


def count_cells(line: str) -> int:
    """Return how many columns a line of a tabular fills."""
    spans = [int(count) for count in re.findall(r"\\multicolumn\{(\d+)\}", line)]
    return len(re.findall(r"(?<!\\)&", line)) + 1 + sum(spans) - len(spans)


@pytest.mark.slow
def test_each_line_of_every_table_fills_its_columns() -> None:
    agents = make_agents_of_results(make_sample_runs().values())
    tables = [*build_comparison_report(agents).tables, build_main_table(agents, PUBLISHED_METHODS)]
    assert len(tables) == 19
    for table in tables:
        lines = format_latex(table).splitlines()
        layout = next(line for line in lines if line.startswith(r"\begin{tabular}"))
        columns = len(layout.removeprefix(r"\begin{tabular}").strip("{}"))
        body = [line for line in lines if line.endswith(r"\\")]
        assert {count_cells(line) for line in body} == {columns} == {len(table.columns)}, table.name
        assert len(body) >= len(table.rows) + 1
        text = "\n".join(lines)
        assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
        for name in ("table", "tabular"):
            assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 1


def test_places_are_bold_underlined_and_waved() -> None:
    columns = (Column("a", "Agent"), Column("d", "D", "G", best=BestValue.HIGHEST, has_sign=True))
    rows = tuple(make_row((name, value)) for name, value in (("x", 1.0), ("y_1", 3.0), ("z", -2.0), ("w", -3.0)))
    text = format_latex(Table("some", "Title", columns, rows, "A note").mark_columns())
    expected = (r"x & \underline{$+$1.00}", r"y\_1 & \textbf{$+$3.00}", r"z & \uwave{$-$2.00}", r"w & $-$3.00")
    assert {rf"{line} \\" for line in expected} <= set(text.splitlines())
    assert r"\label{tab:some}" in text and r"\cmidrule(lr){2-2}" in text and r"\uwave{wavy}" in text
    assert all(package in text.splitlines()[0] for package in PACKAGES)


@pytest.mark.slow
def test_latex_accepts_the_tables(tmp_path: Path) -> None:
    """Where LaTeX is missing, the structure alone is checked: that the document includes each table once."""
    agents = make_agents_of_results(make_sample_runs().values())
    tables = (build_main_table(agents, PUBLISHED_METHODS), *build_comparison_report(agents).tables[2:6])
    for table in tables:
        (tmp_path / f"{table.name}.tex").write_text(format_latex(table))
    text = format_latex_document(tuple(table.name for table in tables), "All & everything")
    assert re.findall(r"\\input\{(.*)\.tex\}", text) == [table.name for table in tables]
    (tmp_path / "all.tex").write_text(text)
    if program := shutil.which("pdflatex"):
        command = [program, "-draftmode", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
        ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
        assert ended.returncode == 0, ended.stdout[-2000:]
