"""What `learn evaluate-detectors` measured, as published pages show it, and RQ3: its order beside that in drives."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import METHOD_NOTE, ConfidenceInterval, describe_comparisons, draw_nested_counts
from mdrive_sumo.core.tables import BestValue, Column, IntervalStyle, Row, Table, format_markdown, make_row
from mdrive_sumo.learning.fusion.detector_figures import FigureKey
from mdrive_sumo.learning.fusion.detector_tables import BASE, FORMAT, DetectorSummary
from mdrive_sumo.report.comparison_report.compared_agent import pool_results
from mdrive_sumo.scenario.scenario import load_model
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import (
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
    list_results,
)
from mdrive_sumo.study.paper.open_closed import CLOSED_METRICS, MIN_AGENTS, correlate_ranks
from mdrive_sumo.study.study_files import make_interval_cell, make_interval_column

DETECTORS_FILE = "detectors.json"
PREFIX = "perception-swap:"
COMPARED = (
    FigureKey("clean", 0.5, "all"),
    FigureKey("clean", 0.7, "all"),
    FigureKey("0.2 m, 100 ms", 0.5, "all"),
    FigureKey("estimated", 0.5, "all"),
)
"""Precisions whose order stands beside that of scores: the usual two, V2XSet's noise, and poses as drives have them."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _Interval(_Part):
    detector: str
    condition: str
    iou: float
    mean: float
    low: float | None
    high: float | None
    units: int
    p_value: float

    def make_interval(self) -> ConfidenceInterval:
        """Return mean and bounds."""
        return ConfidenceInterval(self.mean, self.low, self.high, self.units, self.p_value)


class _Precision(_Interval):
    group: str


class _Difference(_Interval):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)  # `from` is always BASE


class _DetectorsFile(_Part):
    format: Literal["mdrive-sumo/detectors/1"] = FORMAT
    about: dict[str, dict[str, Any]]
    precisions: tuple[_Precision, ...]
    differences: tuple[_Difference, ...]
    use: dict[str, dict[str, dict[str, float]]]


def read_detectors(path: Path) -> DetectorSummary:
    """Return what a `detectors.json` holds. Raises InputError for another file."""
    file = load_model(path, _DetectorsFile)
    if not file.about:
        raise InputError(f"{path}: about: expected one detector or more, found none")
    precisions: dict[str, dict[FigureKey, ConfidenceInterval]] = {name: {} for name in file.about}
    differences: dict[str, dict[str, ConfidenceInterval]] = {}
    for row in file.precisions:
        if row.detector not in precisions:
            raise InputError(f"{path}: precisions: expected one of {', '.join(precisions)}, found {row.detector!r:.40}")
        precisions[row.detector][FigureKey(row.condition, row.iou, row.group)] = row.make_interval()
    for row in file.differences:
        differences.setdefault(row.detector, {})[row.condition] = row.make_interval()
    return DetectorSummary(file.about, precisions, differences, file.use)


def list_detector_order(runs: Sequence[Results], summary: DetectorSummary) -> Sequence[str]:
    """Return the paragraphs of RQ3: precision beside DS and SR of the agents that drive with the detectors.

    Raises InputError for runs that are not of all measured detectors over the same scenarios.
    """
    by_detector = {
        name: pool_results(found)
        for name in summary.precisions
        if (found := [results for results in runs if results.run.agent == f"{PREFIX}{name}"])
    }
    if len(by_detector) < MIN_AGENTS or BASE not in by_detector:
        found = ", ".join(by_detector) or "none"
        raise InputError(
            f"table ap-ds: expected runs of {MIN_AGENTS} detectors or more, {BASE} among them, found {found}"
        )
    tables = {name: group_by_scenario(results.scenarios) for name, results in by_detector.items()}
    common = [name for name in tables[BASE] if all(name in table for table in tables.values())]
    tables = {name: {one: table[one] for one in common} for name, table in tables.items()}
    differences = {
        name: compute_difference_interval(table, tables[BASE], "ds") for name, table in tables.items() if name != BASE
    }
    names = [_name_precision(key) for key in COMPARED]
    columns = (
        Column("detector", "detector"),
        *(Column(name, name, decimals=1, best=BestValue.HIGHEST, undefined="") for name in names),
        *(
            Column(score, score.upper(), best=BestValue.HIGHEST, intervals=IntervalStyle.ENDS, decimals=1)
            for score in CLOSED_METRICS
        ),
        make_interval_column("gain", f"DS - DS of {BASE}", has_sign=True),
    )
    rows = [
        make_row(
            (
                name,
                *(_find_percent(summary, name, key) for key in COMPARED),
                *(make_interval_cell(compute_score_interval(table, score)) for score in CLOSED_METRICS),
                make_interval_cell(differences.get(name)),
            )
        )
        for name, table in tables.items()
    ]
    shown = Table("ap_ds", "", columns, tuple(rows), left=1).mark_columns()
    episodes = [list_results(table, common) for table in tables.values()]
    return (
        format_markdown(shown),
        describe_comparisons([*differences.values()]),
        format_markdown(_build_correlations(summary, [*tables], episodes)),
        "+1: the same order, 0: precision does not tell. " + METHOD_NOTE + " Precisions and detectors stay the same.",
    )


def _name_precision(key: FigureKey) -> str:
    return f"AP@{key.min_iou} {key.condition}"


def _find_percent(summary: DetectorSummary, name: str, key: FigureKey) -> float | None:
    interval = summary.precisions[name].get(key)
    return None if interval is None else 100 * interval.mean


def _build_correlations(
    summary: DetectorSummary, names: Sequence[str], episodes: Sequence[Sequence[ScenarioResult]]
) -> Table:
    """Return rank correlations of precisions and scores. episodes: of each detector, in one order."""
    columns = (
        Column("precision", "precision"),
        Column("score", "score"),
        *(
            Column(name, label, has_sign=True, intervals=IntervalStyle.ENDS)
            for name, label in (("spearman", "Spearman ρ"), ("kendall", "Kendall τ"))
        ),
    )
    labels = [one.label for one in episodes[0]]
    counts = draw_nested_counts(labels)
    rows: list[Row] = []
    for key in COMPARED:
        precisions = [_find_percent(summary, name, key) for name in names]
        if None in precisions:
            continue
        x = np.tile(np.array(precisions, dtype=float), (len(counts), 1))
        for score in CLOSED_METRICS:
            scores = np.array([[getattr(one, score) for one in found] for found in episodes]).T
            cells = map(make_interval_cell, correlate_ranks(x, scores, counts, labels))
            rows.append(make_row((_name_precision(key), score.upper(), *cells)))
    return Table("ap_ds_correlation", "", columns, tuple(rows))
