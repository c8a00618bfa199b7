"""What a channel study found: a line of numbers for every agent in every condition."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.result_tables import Captured
from mdrive_sumo.runs.compare import Interval
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.study.captured_cooperation import captured_of
from mdrive_sumo.study.statistics import by_scenario, difference_interval, score_interval
from mdrive_sumo.study.study_runs import BEST, Row


@dataclass(frozen=True, slots=True)
class Line:
    """One agent in one condition. Intervals are None where every scenario is void."""

    row: Row
    ds: Interval | None
    sr: Interval | None
    ds_difference: Interval | None
    """To the same agent in the base condition, paired by scenario and seed; None for the base condition itself."""
    sr_difference: Interval | None
    captured: Captured | None
    void: int


def lines(rows: Sequence[Row]) -> tuple[Line, ...]:
    """A line for every row; captured cooperation where the rows of the references are there."""
    by_name = {(row.agent, row.condition.name): row for row in rows}
    return tuple(_line(row, by_name) for row in rows)


def _line(row: Row, rows: Mapping[tuple[str, str], Row]) -> Line:
    table = by_scenario(row.scenarios)
    base = by_scenario(rows[row.agent, "base"].scenarios)
    is_base = row.condition.name == "base"
    return Line(
        row,
        ds=score_interval(table, "ds"),
        sr=score_interval(table, "sr"),
        ds_difference=None if is_base else difference_interval(table, base, "ds"),
        sr_difference=None if is_base else difference_interval(table, base, "sr"),
        captured=_captured(row, rows),
        void=sum(scenario.status == "void" for scenario in row.scenarios),
    )


def _captured(row: Row, rows: Mapping[tuple[str, str], Row]) -> Captured | None:
    off, best = rows.get((row.agent, "off")), rows.get((BEST, "base"))
    if off is None or best is None:
        return None
    mode = ScoreMode(row.results[0].run.score_mode)
    try:
        return captured_of(row.scenarios, off.scenarios, best.scenarios, mode)
    except InputError:  # all void: the table says so in its own column
        return None
