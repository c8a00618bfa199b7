"""The run page: one self-contained HTML page of a run that never accesses the network."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined

from mdrive_sumo.report.palette import format_custom_properties
from mdrive_sumo.report.replay_page import hash_for_policy
from mdrive_sumo.report.result_tables import (
    INTERVAL_HEADER,
    build_interval_rows,
    build_score_rows,
    count_infractions,
    count_outcomes,
    describe_agent,
    describe_seeds,
    format_scores,
    list_void,
)
from mdrive_sumo.report.run_page.run_page_data import RunPageData
from mdrive_sumo.scoring import compute_category_means


def render_run_page(data: RunPageData, *, replays_note: str = "") -> str:
    """Return the page. The same run gives the same bytes. replays_note: a sentence about which replays there are."""
    results = data.stored.results
    header, rows = build_score_rows(results)
    category_rows = [
        (name, str(means.scenarios), *format_scores(means), str(means.timed))
        for name, means in compute_category_means(results.scenarios).items()
    ]
    return render_page(
        "run_page.html",
        title=f"{results.run.suite}: {describe_agent(results)} · mdrive-sumo",
        data=data,
        run=results.run,
        agent=describe_agent(results),
        seeds_text=describe_seeds(results.run),
        overall=results.overall,
        score_header=header,
        score_rows=rows,
        category_header=("category", *header[1:]),
        category_rows=category_rows,
        interval_header=INTERVAL_HEADER,
        interval_rows=build_interval_rows(results),
        outcomes=count_outcomes(results),
        infractions=count_infractions(results),
        void=len(list_void(results)),
        replays_note=_describe_missing_recordings(data) or replays_note,
    )


def render_page(template: str, **values: Any) -> str:
    """Return a page of `report/static` with the style and the script of pages that list scenarios.

    Its content policy forbids every connection and every script but this.
    """
    style = format_custom_properties() + _read_static("overview.css")
    script = _read_static("overview.js")
    environment = Environment(
        loader=FunctionLoader(_read_static),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        style=style, style_hash=hash_for_policy(style), script=script, script_hash=hash_for_policy(script), **values
    )


def _read_static(name: str) -> str:
    return (files("mdrive_sumo.report") / "static" / name).read_text("utf-8")


def _describe_missing_recordings(data: RunPageData) -> str:
    return "" if data.has_recordings else "This run was made with --no-record: there are no replays."
