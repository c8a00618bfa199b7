"""Report tables as values: ranks, cells, and the writers of Markdown and CSV."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_nested
from mdrive_sumo.core.tables import (
    BestValue,
    Cell,
    Column,
    IntervalStyle,
    Table,
    format_cell,
    format_csv,
    format_markdown,
    format_text,
    make_row,
)

NUMBER = Column("ds", "DS", best=BestValue.HIGHEST)
NAME = Column("agent", "Agent")
INTERVAL = ConfidenceInterval(80.0, 70.0, 84.0, 20)


def make_table(*values: float | None, best: BestValue = BestValue.HIGHEST, unranked: int = 0) -> Table:
    """Return a table of one column; the last `unranked` rows do not compete."""
    rows = tuple(make_row((value,), is_ranked=i < len(values) - unranked) for i, value in enumerate(values))
    return Table("t", "T", (Column("ds", "DS", best=best),), rows)


def list_ranks(table: Table) -> list[int]:
    return [cell.rank for cell in table.mark_columns().find_column("ds")]


@pytest.mark.parametrize(
    ("values", "best", "ranks"),
    [
        ((1.0, 3.0, 2.0, 0.0), BestValue.HIGHEST, [3, 1, 2, 0]),
        ((1.0, 3.0, 2.0, 0.0), BestValue.LOWEST, [2, 0, 3, 1]),
        ((1.0, 3.0), BestValue.NONE, [0, 0]),
        ((5.0, 5.0, 4.0, 3.0), BestValue.HIGHEST, [1, 1, 3, 0]),
        ((5.001, 5.002, 4.0), BestValue.HIGHEST, [1, 1, 3]),  # equal as shown
        ((5.0, 5.0), BestValue.HIGHEST, [0, 0]),  # no place that tells anything
        ((None, 5.0, 4.0), BestValue.HIGHEST, [0, 1, 2]),
        ((5.0,), BestValue.HIGHEST, [0]),
    ],
)
def test_the_best_three_are_marked(values: tuple[float | None, ...], best: BestValue, ranks: list[int]) -> None:
    assert list_ranks(make_table(*values, best=best)) == ranks


@given(st.lists(st.floats(0, 100), min_size=1, max_size=8), st.integers(0, 8))
def test_a_rank_counts_the_better_rows_that_compete(values: list[float], unranked: int) -> None:
    unranked = min(unranked, len(values))
    ranks = list_ranks(make_table(*values, unranked=unranked))
    competing = [round(value, 2) for value in values[: len(values) - unranked]]
    assert ranks[len(competing) :] == [0] * unranked
    if len(set(competing)) < 2:
        assert ranks == [0] * len(values)
        return
    for value, rank in zip(competing, ranks, strict=False):
        better = sum(other > value for other in competing)
        assert rank == (better + 1 if better < 3 else 0)


def test_rows_and_sections_are_ranked_on_their_own() -> None:
    columns = (NAME, Column("a", "a", best=BestValue.HIGHEST), Column("b", "b", best=BestValue.HIGHEST))
    rows = (make_row(("x", 1.0, 2.0), "one"), make_row(("y", 4.0, 3.0), "two"), make_row(("z", 5.0, 1.0), "two"))
    table = Table("t", "T", columns, rows)
    by_row, by_section = (
        [[cell.rank for cell in row.cells] for row in marked.rows]
        for marked in (table.mark_rows(), table.mark_sections())
    )
    assert by_row == [[0, 2, 1], [0, 1, 2], [0, 1, 2]]
    assert by_section == [[0, 0, 0], [0, 2, 1], [0, 1, 2]]


@pytest.mark.parametrize(
    ("value", "column", "text"),
    [
        (None, NUMBER, "-"),
        (True, NUMBER, "✓"),
        (False, NUMBER, "×"),
        ("idm", NAME, "idm"),
        (80.0, NUMBER, "80.00 ± 7.00"),
        (80.0, Column("d", "d", has_sign=True, intervals=IntervalStyle.ENDS), "+80.00 [+70.00, +84.00]"),
        (-0.001, Column("d", "d", has_sign=True), "+0.00 ± 7.00"),
        (3.0, Column("n", "n", decimals=0), "3 ± 7"),
    ],
)
def test_cells_as_text(value: object, column: Column, text: str) -> None:
    assert format_cell(Cell(value, INTERVAL), column) == text


@pytest.mark.parametrize(
    ("style", "text"), [(IntervalStyle.ENDS, "80.00 [too few]"), (IntervalStyle.HALF_WIDTH, "80.00")]
)
def test_an_interval_over_too_few_scenarios_has_no_ends(style: IntervalStyle, text: str) -> None:
    cell = Cell(80.0, bootstrap_nested(np.full(9, 80.0), [(i,) for i in range(9)]))
    assert format_cell(cell, Column("d", "d", intervals=style)) == text
    table = Table("t", "T", (NAME, NUMBER), (make_row(("a", cell)),))
    assert [*csv.DictReader(io.StringIO(format_csv(table)))] == [
        {"agent": "a", "ds": "80", "ds_low": "", "ds_high": ""}
    ]


def test_csv_has_full_precision_and_both_ends_of_intervals() -> None:
    rows = (
        make_row(('a,"b"', Cell(80.123456789, INTERVAL), True), "one"),
        make_row(("c", None, False), "two"),
    )
    columns = (NAME, NUMBER, Column("flag", "Flag"))
    found = list(csv.DictReader(io.StringIO(format_csv(Table("t", "T", columns, rows)))))
    first = {"section": "one", "agent": 'a,"b"', "ds": "80.123457", "ds_low": "70", "ds_high": "84", "flag": "yes"}
    empty = {"section": "two", "agent": "c", "ds": "", "ds_low": "", "ds_high": "", "flag": "no"}
    assert found == [first, empty]


def test_markdown_and_terminal_show_groups_sections_and_marks() -> None:
    columns = (NAME, Column("ds", "DS", "Bucket", best=BestValue.HIGHEST))
    rows = (make_row(("a|b", 1.0), "First"), make_row(("c", 2.0), "Second"))
    table = Table("t", "T", columns, rows).mark_columns()
    assert format_markdown(table).splitlines() == [
        "| Agent | Bucket DS |",
        "| --- | ---: |",
        "| *First* |  |",
        "| a\\|b | 1.00 (2) |",
        "| *Second* |  |",
        "| c | **2.00** |",
    ]
    assert table.groups == (("", 1), ("Bucket", 1))
    assert format_text(table).splitlines() == [
        "Agent    Bucket DS", "------------------", "First:", "a|b           1.00", "Second:", "c             2.00",
    ]  # fmt: skip


def test_an_unknown_column_is_named() -> None:
    with pytest.raises(KeyError, match="expected a column of ds"):
        make_table(1.0).find_column("sr")
