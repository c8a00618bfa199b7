"""The comparison page: several runs against the first of them, in one self-contained HTML page."""

from mdrive_sumo.core.statistics import TOO_FEW_NOTE
from mdrive_sumo.core.tables import CellValue, Column, Table, make_row, make_text_columns
from mdrive_sumo.report.result_tables import SCORE_COLUMNS, describe_seeds, list_bounds, list_scores
from mdrive_sumo.report.run_page.comparison_data import ComparisonData
from mdrive_sumo.report.run_page.run_page import render_overview
from mdrive_sumo.runs.compare import RunComparison

DIFFERENCE_COLUMNS = (
    *make_text_columns({"runs": "", "score": "score"}),
    Column("scenarios", "scenarios", decimals=0),
    *(Column(label, label, has_sign=True) for label in ("mean", "95 % from", "to")),
    *(Column(label, label, decimals=0, undefined="") for label in ("better", "equal", "worse")),
)

TIME_RATIO = "time ratio"


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
        too_few_note=TOO_FEW_NOTE if any(one.ds.ends is None for one in data.comparisons) else "",
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
