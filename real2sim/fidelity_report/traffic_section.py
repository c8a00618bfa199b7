"""Report section on reactive traffic: drift over time, order at conflict points, absent vehicles."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure, format_frames, format_share
from real2sim.fidelity_report.html import Markup, join_markup, link_entry, render_collapsible_list, render_table, tag
from real2sim.fidelity_report.line_chart import ChartSeries, LineChart, draw_chart
from real2sim.fidelity_report.report_entry import ReportEntry, number_by_id
from real2sim.traffic_fidelity import MEDIAN_5S_M, PositionErrors, TrafficFidelity

HEAD = ("after departure [s]", "vehicles", "lower quartile [m]", "median [m]", "upper quartile [m]", "worst [m]")
CAPTION = "Measured at the times of the table, over the vehicles that the log still contains."
MAX_SHOWN_M = 20.0
"""[m] Upper limit of the chart: an absent vehicle counts 100 m, which would flatten all other curves."""


def render_traffic_section(findings: ConversionFindings, entries: tuple[ReportEntry, ...]) -> Markup:
    """Return text, chart, table and lists; a scenario uses other ids than the tracks of its log."""
    closeness = findings.closeness
    if closeness is None:
        return tag("p", "Not measured.", class_="none")
    by_id = number_by_id(entries)
    numbers = by_id | {name: by_id[id_] for id_, name in findings.names.items() if id_ in by_id}

    def pair(a: str, b: str, more: str = "") -> Markup:
        return join_markup((link_entry(a, numbers), " and ", link_entry(b, numbers), more))

    return join_markup(
        (
            tag("p", _describe_fidelity(closeness)),
            tag("figure", _draw_drift_chart(closeness.errors), tag("figcaption", CAPTION), class_="drift"),
            _render_error_table(closeness.errors),
            render_collapsible_list(
                "Passing order different from the log", [pair(a, b) for a, b in closeness.order_changed]
            ),
            render_collapsible_list("Could not depart", [link_entry(name, numbers) for name in closeness.not_departed]),
            render_collapsible_list(
                "Departed late",
                [
                    join_markup((link_entry(name, numbers), f", {delay:.1f} s"))
                    for name, delay in closeness.departed_late
                ],
            ),
            render_collapsible_list(
                "Left before the vehicle of the log", [link_entry(name, numbers) for name in closeness.left_early]
            ),
            render_collapsible_list(
                "Contacts that are not in the log",
                [pair(a, b, f", {format_frames(n)}") for a, b, n in closeness.contacts],
            ),
            render_collapsible_list(
                "Vehicles that stall when the scenario is driven",
                [join_markup((link_entry(one.id, numbers), ": ", one.format_sentence())) for one in findings.stalled],
            ),
        )
    )


def _describe_fidelity(closeness: TrafficFidelity) -> str:
    drift = format_figure(closeness.median_at_5s, "m")
    order = (
        f"{closeness.order_kept} of {closeness.order_pairs} pairs ({format_share(closeness.order_share)}) pass their"
        " conflict point in the log's order."
        if closeness.order_pairs
        else "No two of them share a conflict point."
    )
    return (
        f"The {closeness.vehicles} background vehicles drive in SUMO ({closeness.mode}) while the CAVs and the scripted"
        f" actors repeat the log. After 5 s half of the background vehicles are within {drift} of the log"
        f" (at most {MEDIAN_5S_M:g} m). {order}"
    )


def _draw_drift_chart(errors: Sequence[PositionErrors]) -> Markup:
    lower, median, upper = (_values(errors, name) for name in ("lower", "median", "upper"))
    times = np.array([error.after_s for error in errors], dtype=np.float64)
    known = times[np.isfinite(median)]
    span = (float(known[0]), float(known[-1])) if len(known) > 1 else (0.0, 1.0)
    most = float(np.nanmax(upper, initial=0.0, where=np.isfinite(upper)))
    top = float(np.clip(1.15 * most, 1.2 * MEDIAN_5S_M, MAX_SHOWN_M))
    series = (ChartSeries("band", times, lower, upper), ChartSeries("line", times, median))
    label = "Distance between simulated and logged vehicles over time since departure: median, and quartiles as a band"
    title = "distance to the log [m]: median and quartiles"
    return draw_chart(LineChart(label, title, series, span, top, (MEDIAN_5S_M,), "time since departure [s]"))


def _values(errors: Sequence[PositionErrors], name: str) -> Float:
    values = [getattr(error, name) for error in errors]
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _render_error_table(errors: Sequence[PositionErrors]) -> Markup:
    rows = [
        (
            f"{e.after_s:g}",
            f"{e.vehicles}",
            format_figure(e.lower),
            format_figure(e.median),
            format_figure(e.upper),
            format_figure(e.worst),
        )
        for e in errors
    ]
    return render_table(HEAD, rows, "Distance to the log over time")
