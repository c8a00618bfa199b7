"""The run page and the comparison page: one self-contained HTML page each that never accesses the network."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from mdrive_sumo.core.statistics import TOO_FEW_NOTE, describe_comparisons
from mdrive_sumo.core.tables import CellValue, Column, Table, make_row, make_text_columns
from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.report.result_tables import (
    SCORE_COLUMNS,
    build_interval_table,
    build_score_table,
    count_infractions,
    count_outcomes,
    describe_agent,
    describe_partial,
    describe_seeds,
    list_bounds,
    list_scores,
    list_void,
    make_score_table,
)
from mdrive_sumo.report.run_page.comparison_data import ComparisonData
from mdrive_sumo.report.run_page.run_page_data import RunPageData
from mdrive_sumo.runs.compare import RunComparison, list_differences
from mdrive_sumo.scoring import compute_category_means

SCORE_TERMS: Mapping[str, str] = MappingProxyType(
    {
        "DS": "driving score in percent: RC x IP",
        "SR": "success rate in percent: share of CAVs with DS > 99.95",
        "RC": "route completion in percent",
        "IP": "infraction penalty: the product of the factors of all infractions, 1 if there are none",
        "efficient SR": ("success rate in percent that counts only successes within twice the time of `omniscient`"),
        "time ratio": (
            "the time that a CAV needs to arrive divided by the time of `omniscient`, averaged over the CAVs of a"
            " scenario if all arrive"
        ),
        "timed": "of a scenario: every CAV arrived, so that it has a time ratio",
        "void": "of an episode: made worthless by a failure of mdrive-sumo or SUMO, never by the agent",
    }
)
"""Term -> its row in the glossary."""


DIFFERENCE_COLUMNS = (
    *make_text_columns({"runs": "", "score": "score"}),
    Column("scenarios", "scenarios", decimals=0),
    *(Column(label, label, has_sign=True) for label in ("mean", "95 % from", "to")),
    *(Column(label, label, decimals=0, undefined="") for label in ("better", "equal", "worse")),
)

TIME_RATIO = "time ratio"


def render_run_page(data: RunPageData, *, replays_note: str = "", refresh_s: int = 0) -> str:
    """Return the page. The same run gives the same bytes.

    replays_note: a sentence about which replays there are. refresh_s: how often a browser loads it anew; 0: never.
    """
    results = data.stored.results
    categories = [
        (name, means.scenarios, *list_scores(means), means.timed)
        for name, means in compute_category_means(results.scenarios).items()
    ]
    return render_overview(
        "run_page.html",
        title=f"{results.run.suite_label}: {describe_agent(results)} · mdrive-sumo",
        data=data,
        run=results.run,
        partial=describe_partial(results),
        refresh_s=refresh_s,
        agent=describe_agent(results),
        seeds_text=describe_seeds(results.run),
        overall=results.overall,
        score_table=build_score_table(results),
        category_table=make_score_table("category", categories),
        interval_table=build_interval_table(results),
        outcomes=count_outcomes(results),
        infractions=count_infractions(results),
        void=len(list_void(results)),
        terms=SCORE_TERMS,
        replays_note=replays_note
        if data.has_recordings
        else "This run was made with --no-record: there are no replays.",
    )


def render_overview(template: str, **values: Any) -> str:
    """Return a page of `report/static` with the style and the script of pages that list scenarios."""
    style = format_custom_properties() + read_static("overview.css")
    return render_html_page(template, style=style, script=read_static("overview.js"), **values)


def render_comparison_page(data: ComparisonData, *, replays_note: str = "") -> str:
    """Return the page. The same runs give the same bytes. replays_note: a sentence about which replays there are."""
    first = data.runs[0].stored.results.run
    return render_overview(
        "comparison_page.html",
        title=f"{' and '.join(run.agent for run in data.runs)} on {first.suite} · mdrive-sumo",
        data=data,
        first=data.runs[0],
        suite=first.suite,
        seeds=[describe_seeds(run.stored.results.run) for run in data.runs],
        score_table=_build_score_table(data),
        difference_table=_build_difference_table(data),
        too_few_note=" ".join(
            filter(
                None,
                (
                    describe_comparisons([one for entry in data.comparisons for one in list_differences(entry)]),
                    TOO_FEW_NOTE if any(comparison.ds.ends is None for comparison in data.comparisons) else "",
                ),
            )
        ),
        outcomes=("worse", "better", "equal", "not compared"),
        replays_note=" ".join(filter(None, (replays_note, _describe_missing_recordings(data)))),
    )


def _build_score_table(data: ComparisonData) -> Table:
    means = [(run.letter, run.agent, run.stored.results.overall.scenario_mean) for run in data.runs]
    columns = (*make_text_columns({"run": "run", "agent": "agent"}), *SCORE_COLUMNS)
    rows = [make_row((letter, agent, *list_scores(scores))) for letter, agent, scores in means]
    return Table("scores", "Scores", columns, tuple(rows))


def _build_difference_table(data: ComparisonData) -> Table:
    rows = [
        make_row(row)
        for run, comparison in zip(data.runs[1:], data.comparisons, strict=True)
        for row in _list_differences(f"{run.letter} - A", comparison)
    ]
    return Table("differences", "Paired differences", DIFFERENCE_COLUMNS, tuple(rows))


def _list_differences(name: str, comparison: RunComparison) -> list[tuple[CellValue, ...]]:
    intervals = {
        "DS": comparison.ds,
        "SR": comparison.sr,
        "efficient SR": comparison.efficient_sr,
        TIME_RATIO: comparison.time_ratio,
    }
    return [
        (
            name if i == 0 else "",
            score,
            comparison.timed if score == TIME_RATIO else len(comparison.pairs),
            *list_bounds(interval),
            *(comparison.count_wins_ties_losses() if i == 0 else (None,) * 3),
        )
        for i, (score, interval) in enumerate(intervals.items())
    ]


def _describe_missing_recordings(data: ComparisonData) -> str:
    names = [run.letter for run in data.runs if not run.stored.run.config.record]
    return f"Made with --no-record, so without replays: {', '.join(names)}." if names else ""
