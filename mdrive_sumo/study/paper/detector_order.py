"""Agents that differ in their detector only: precision beside driving, and whether one order tells the other (RQ3)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.statistics import METHOD_NOTE, describe_comparisons, draw_nested_counts
from mdrive_sumo.core.tables import BestValue, Column, IntervalStyle, Table, make_row
from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
    list_results,
)
from mdrive_sumo.study.paper.open_closed import (
    CLOSED_METRICS,
    MIN_AGENTS,
    RankCorrelation,
    compare_open_with_closed,
    correlate_ranks,
)
from mdrive_sumo.study.paper.paper_study import DETECTOR_PREFIX, SURROGATE_SUFFIX
from mdrive_sumo.study.study_files import make_interval_cell, make_interval_column

BASE = "none"
"""The detector that gets nothing from others."""
Precisions = Mapping[str, Mapping[str, float]]
"""[%] By name of the measure and detector, on test frames of `learn evaluate-detectors`."""
OPEN_PRECISION = "AP50 in open loop"
SURROGATES = "surrogates: error models of published precision, no detectors"


def select_detectors(runs: Mapping[str, Results]) -> dict[str, Results]:
    """Return the runs of `perception-swap:*` by detector, surrogates last."""
    found = {name.removeprefix(DETECTOR_PREFIX): run for name, run in runs.items() if name.startswith(DETECTOR_PREFIX)}
    return dict(sorted(found.items(), key=lambda item: item[0].endswith(SURROGATE_SUFFIX)))


def _share_scenarios(runs: Mapping[str, Results]) -> dict[str, ResultTable]:
    """Return the results of each detector over the scenarios that all have."""
    tables = {name: group_by_scenario(results.scenarios) for name, results in runs.items()}
    common = [one for one in next(iter(tables.values()), {}) if all(one in table for table in tables.values())]
    return {name: {one: table[one] for one in common} for name, table in tables.items()}


def build_detector_table(runs: Mapping[str, Results], precisions: Precisions) -> Table:
    """Return precision, DS and SR of each detector. runs: by detector."""
    tables = _share_scenarios(runs)
    differences = {
        name: compute_difference_interval(table, tables[BASE], "ds")
        for name, table in tables.items()
        if name != BASE and BASE in tables and not name.endswith(SURROGATE_SUFFIX)
    }
    columns = (
        Column("detector", "detector"),
        *(Column(name, name, decimals=1, best=BestValue.HIGHEST, undefined="") for name in precisions),
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
                *(values.get(name) for values in precisions.values()),
                *(make_interval_cell(compute_score_interval(table, score)) for score in CLOSED_METRICS),
                make_interval_cell(differences.get(name)),
            ),
            SURROGATES if name.endswith(SURROGATE_SUFFIX) else "",
            is_ranked=not name.endswith(SURROGATE_SUFFIX),
        )
        for name, table in tables.items()
    ]
    note = describe_comparisons([*differences.values()])
    return Table("detectors", "Detectors: precision and driving", columns, tuple(rows), note, left=1).mark_columns()


def correlate_precisions(runs: Mapping[str, Results], precisions: Precisions) -> tuple[RankCorrelation, ...]:
    """Return the correlation of each measure of precision with each score, over the trained detectors that have it."""
    trained = {name: run for name, run in runs.items() if not name.endswith(SURROGATE_SUFFIX)}
    found: list[RankCorrelation] = []
    for measure, values in precisions.items():
        tables = _share_scenarios({name: run for name, run in trained.items() if name in values})
        if len(tables) < MIN_AGENTS or not next(iter(tables.values())):
            continue
        episodes = [list_results(table, [*table]) for table in tables.values()]
        labels = [one.label for one in episodes[0]]
        counts = draw_nested_counts(labels)
        x = np.tile(np.array([values[name] for name in tables]), (len(counts), 1))
        for score in CLOSED_METRICS:
            scores = np.array([[getattr(one, score) for one in members] for members in episodes]).T
            found.append(RankCorrelation(measure, score, (*tables,), *correlate_ranks(x, scores, counts, labels)))
    return tuple(found)


def correlate_open_precision(
    opened: Mapping[str, OpenLoopResults], closed: Mapping[str, Results]
) -> tuple[RankCorrelation, ...]:
    """Return the correlation of precision in open loop with each score, over trained detectors of `perception-swap:*`.

    opened, closed: by agent.
    """
    trained = {
        name: results
        for name, results in opened.items()
        if name.startswith(DETECTOR_PREFIX) and not name.endswith(SURROGATE_SUFFIX)
    }
    correlations = compare_open_with_closed(trained, closed).correlations if len(trained) >= MIN_AGENTS else ()
    return tuple(replace(one, metric=OPEN_PRECISION) for one in correlations if one.metric == "ap50")


def build_precision_correlations(correlations: Sequence[RankCorrelation]) -> Table:
    """Return the table of rank correlations of precision and scores."""
    columns = (
        Column("precision", "precision"),
        Column("score", "score"),
        *(
            Column(name, label, has_sign=True, intervals=IntervalStyle.ENDS)
            for name, label in (("spearman", "Spearman ρ"), ("kendall", "Kendall τ"))
        ),
    )
    rows = [
        make_row((one.metric, one.score.upper(), make_interval_cell(one.spearman), make_interval_cell(one.kendall)))
        for one in correlations
    ]
    note = (
        f"+1: the same order, 0: precision does not tell. {METHOD_NOTE} Detectors stay the same, and so do precisions,"
        " but for those in open loop. Surrogates are in none of these."
    )
    return Table("precision_correlation", "Rank correlation of precision and driving", columns, tuple(rows), note)
