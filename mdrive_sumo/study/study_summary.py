"""Summary of a channel study: a line of numbers for every agent in every condition."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_clustered_mean
from mdrive_sumo.report.result_tables import CapturedCooperation
from mdrive_sumo.scoring import ScenarioResult, ScoreMode
from mdrive_sumo.study.captured_cooperation import compute_captured_from_scenarios
from mdrive_sumo.study.study_runs import BEST, StudyRow

ResultTable = Mapping[str, Mapping[int, ScenarioResult]]
"""Results by scenario id and seed."""


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
    """None without reference times."""
    time_ratio: ConfidenceInterval | None
    """Over the scenarios in which every CAV arrives with every seed."""
    timed: int
    """Number of these scenarios."""
    captured: CapturedCooperation | None
    void: int


def summarise_rows(rows: Sequence[StudyRow]) -> tuple[StudyLine, ...]:
    """Return a line for every row, with captured cooperation where the rows of the references exist."""
    by_name = {(row.agent, row.condition.name): row for row in rows}
    return tuple(_summarise_row(row, by_name) for row in rows)


def _summarise_row(row: StudyRow, rows: Mapping[tuple[str, str], StudyRow]) -> StudyLine:
    table = group_by_scenario(row.scenarios)
    base = group_by_scenario(rows[row.agent, "base"].scenarios)
    is_base = row.condition.name == "base"
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
    )


def _compute_captured(row: StudyRow, rows: Mapping[tuple[str, str], StudyRow]) -> CapturedCooperation | None:
    off, best = rows.get((row.agent, "off")), rows.get((BEST, "base"))
    if off is None or best is None:
        return None
    mode = ScoreMode(row.results[0].run.score_mode)
    try:
        return compute_captured_from_scenarios(row.scenarios, off.scenarios, best.scenarios, mode)
    except InputError:  # all void: the table says so in its own column
        return None


def group_by_scenario(results: Sequence[ScenarioResult]) -> dict[str, dict[int, ScenarioResult]]:
    """Return results by scenario id and seed; scenarios with a void result are left out, so that all count the same."""
    found: dict[str, dict[int, ScenarioResult]] = {}
    for result in results:
        found.setdefault(result.id, {})[result.seed] = result
    return {name: by_seed for name, by_seed in found.items() if all(one.status == "ok" for one in by_seed.values())}


def select_defined(table: ResultTable, name: str) -> ResultTable:
    """Return the scenarios in which a score is defined with every seed."""
    return {
        scenario: by_seed
        for scenario, by_seed in table.items()
        if all(getattr(one, name) is not None for one in by_seed.values())
    }


def compute_score_interval(table: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of a score by its field's name; None if the table is empty."""
    values = [[getattr(one, name) for _, one in sorted(by_seed.items())] for by_seed in table.values()]
    return bootstrap_clustered_mean(np.array(values)) if values else None


def compute_difference_interval(table: ResultTable, base: ResultTable, name: str) -> ConfidenceInterval | None:
    """Return mean and interval of the paired differences to the base condition; None if they share no scenario."""
    values = [
        [getattr(table[scenario][seed], name) - getattr(base[scenario][seed], name) for seed in sorted(table[scenario])]
        for scenario in table
        if scenario in base
    ]
    return bootstrap_clustered_mean(np.array(values)) if values else None
