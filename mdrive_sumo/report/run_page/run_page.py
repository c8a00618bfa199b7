"""The run page: one self-contained HTML page of a run that never accesses the network."""

from typing import Any

from mdrive_sumo.report.html_page import read_static, render_html_page
from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.report.result_tables import (
    build_interval_table,
    build_score_table,
    count_infractions,
    count_outcomes,
    describe_agent,
    describe_partial,
    describe_seeds,
    list_scores,
    list_void,
    make_score_table,
)
from mdrive_sumo.report.run_page.run_page_data import RunPageData
from mdrive_sumo.report.score_terms import SCORE_TERMS
from mdrive_sumo.scoring import compute_category_means


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
        title=f"{results.run.suite}: {describe_agent(results)} · mdrive-sumo",
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
        replays_note=_describe_missing_recordings(data) or replays_note,
    )


def render_overview(template: str, **values: Any) -> str:
    """Return a page of `report/static` with the style and the script of pages that list scenarios."""
    style = format_custom_properties() + read_static("overview.css")
    return render_html_page(template, style=style, script=read_static("overview.js"), **values)


def _describe_missing_recordings(data: RunPageData) -> str:
    return "" if data.has_recordings else "This run was made with --no-record: there are no replays."
