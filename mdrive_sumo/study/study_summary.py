"""Summary of a channel study: a line of numbers for every agent in every condition."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation, compute_captured_from_scenarios
from mdrive_sumo.scoring.paired_intervals import (
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
    select_defined,
)
from mdrive_sumo.study.conditions import BASE
from mdrive_sumo.study.study_runs import BEST, StudyRow


@dataclass(frozen=True, slots=True)
class StudyLine:
    """One agent in one condition. Intervals are None where every scenario is void."""

    row: StudyRow
    ds: ConfidenceInterval | None
    sr: ConfidenceInterval | None
    ds_difference: ConfidenceInterval | None
    """To the same agent in the base condition, paired by scenario and seed; None for the base condition itself."""
    sr_difference: ConfidenceInterval | None
    efficient_sr: ConfidenceInterval | None
    """Efficient SR [%]; None without reference times."""
    time_ratio: ConfidenceInterval | None
    """Over the scenarios in which every CAV arrives with every seed."""
    timed: int
    """Number of scenarios in which every CAV arrives with every seed."""
    captured: CapturedCooperation | None
    void: int
    bytes_s: float | None
    """Payload bytes that all stations together send in a second, a message to many counting once; None at fixed
    intervals."""
    busy_ratio: float | None
    """Share of the time that the channel is busy at the CAVs; None without a radio. Like the rest a mean over scenarios
    and seeds."""


def summarise_rows(rows: Sequence[StudyRow]) -> tuple[StudyLine, ...]:
    """Return a line for every row, with captured cooperation where the rows of the references exist."""
    by_name = {(row.agent, row.condition.name): row for row in rows}
    return tuple(_summarise_row(row, by_name) for row in rows)


def _summarise_row(row: StudyRow, rows: Mapping[tuple[str, str], StudyRow]) -> StudyLine:
    table = group_by_scenario(row.scenarios)
    base = group_by_scenario(rows[row.agent, BASE].scenarios)
    is_base = row.condition.name == BASE
    timed = select_defined(table, "time_ratio")
    return StudyLine(
        row,
        ds=compute_score_interval(table, "ds"),
        sr=compute_score_interval(table, "sr"),
        ds_difference=None if is_base else compute_difference_interval(table, base, "ds"),
        sr_difference=None if is_base else compute_difference_interval(table, base, "sr"),
        efficient_sr=compute_score_interval(select_defined(table, "efficient_sr"), "efficient_sr"),
        time_ratio=compute_score_interval(timed, "time_ratio"),
        timed=len(timed),
        captured=_compute_captured(row, rows),
        void=sum(scenario.status == "void" for scenario in row.scenarios),
        bytes_s=_compute_mean(
            math.fsum(rate.bytes_s for rate in one.sent_rates.values()) for one in row.scenarios if one.sent_rates
        ),
        busy_ratio=_compute_mean(one.busy_ratio.mean for one in row.scenarios if one.busy_ratio is not None),
    )


def _compute_mean(numbers: Iterable[float]) -> float | None:
    found = [*numbers]
    return math.fsum(found) / len(found) if found else None


def _compute_captured(row: StudyRow, rows: Mapping[tuple[str, str], StudyRow]) -> CapturedCooperation | None:
    off, best = rows.get((row.agent, "off")), rows.get((BEST, BASE))
    if off is None or best is None:
        return None
    mode = ScoreMode(row.results[0].run.score_mode)
    try:
        return compute_captured_from_scenarios(row.scenarios, off.scenarios, best.scenarios, mode)
    except InputError:  # all void: the table says so in its own column
        return None
