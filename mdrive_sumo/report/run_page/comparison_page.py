"""The comparison page: several runs against the first of them, in one self-contained HTML page."""

from mdrive_sumo.core.statistics import TOO_FEW_NOTE, format_interval_cells
from mdrive_sumo.core.tables import TableRow
from mdrive_sumo.report.result_tables import SCORE_HEADER, describe_seeds, format_scores
from mdrive_sumo.report.run_page.comparison_data import ComparisonData
from mdrive_sumo.report.run_page.run_page import render_overview
from mdrive_sumo.runs.compare import RunComparison

DIFFERENCE_HEADER: TableRow = ("", "score", "scenarios", "mean", "95 % from", "to", "better", "equal", "worse")

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
        score_header=("run", "agent", *SCORE_HEADER),
        score_rows=[
            (run.letter, run.agent, *format_scores(run.stored.results.overall.scenario_mean)) for run in data.runs
        ],
        difference_header=DIFFERENCE_HEADER,
        too_few_note=TOO_FEW_NOTE if any(one.ds.ends is None for one in data.comparisons) else "",
        difference_rows=[
            row
            for run, comparison in zip(data.runs[1:], data.comparisons, strict=True)
            for row in _list_differences(f"{run.letter} - A", comparison)
        ],
        outcomes=("worse", "better", "equal", "not compared"),
        replays_note=" ".join(filter(None, (replays_note, _describe_missing_recordings(data)))),
    )


def _list_differences(name: str, comparison: RunComparison) -> list[TableRow]:
    intervals = {
        "DS": comparison.ds,
        "SR": comparison.sr,
        "efficient SR": comparison.efficient_sr,
        TIME_RATIO: comparison.time_ratio,
    }
    counts = [str(count) for count in comparison.count_wins_ties_losses()]
    return [
        (
            name if i == 0 else "",
            score,
            str(comparison.timed if score == TIME_RATIO else len(comparison.pairs)),
            *format_interval_cells(interval, "+.2f"),
            *(counts if i == 0 else ("", "", "")),
        )
        for i, (score, interval) in enumerate(intervals.items())
    ]


def _describe_missing_recordings(data: ComparisonData) -> str:
    names = [run.letter for run in data.runs if not run.stored.run.config.record]
    return f"Made with --no-record, so without replays: {', '.join(names)}." if names else ""
