"""The report of one conversion: a page that shows how faithful a scenario is to its log, and where it deviates."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mdrive_sumo.core.output_files import write_text
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.charts import draw_actor_charts, draw_drift_chart
from real2sim.fidelity_report.formatting import CLEANING_ACTIONS, describe_figure, format_figure, format_frames
from real2sim.fidelity_report.html import PAGE, render_page
from real2sim.fidelity_report.map_figures import (
    compute_deviation,
    draw_actor_map,
    draw_definitions,
    draw_deviation,
    draw_infractions,
    draw_overview,
    fit_map_frame,
)
from real2sim.fidelity_report.report_entry import ReportEntry, build_entries
from real2sim.fidelity_targets import CENTRE_LINES_MEAN_M, CENTRE_LINES_P95_M, FidelityTarget
from real2sim.network import NetworkReport
from real2sim.quality import CHECKS
from real2sim.traffic_fidelity import MEDIAN_5S_M

HEADING_BY_GROUP = {
    "fail": "Fails a check",
    "cav": "CAVs",
    "pass": "Moving vehicles that pass",
    "walk": "Pedestrians and cyclists that pass",
    "rest": "Static objects that pass",
}
"""Headings of the cards of actors, by `ReportEntry.group`."""
Cells = tuple[str, ...]
"""One row of a table."""


def write_report(folder: Path, findings: ConversionFindings) -> Path:
    """Write `conversion.html` into the scenario's folder. The same findings give the same bytes."""
    path = folder / PAGE
    write_text(path, render_report(findings))
    return path


def render_report(findings: ConversionFindings) -> str:
    """Return the page as text."""
    entries = build_entries(findings)
    map_frame = fit_map_frame(entries)
    numbers = {entry.actor.id: entry.number for entry in entries}
    dt_s = findings.cleaned.dt_s
    return render_page(
        "report.html",
        f"{findings.id} · conversion",
        findings=findings,
        facts=_list_facts(findings),
        tiles=_build_tiles(findings),
        definitions=draw_definitions(map_frame, findings.roads, entries),
        overview=draw_overview(map_frame, entries),
        entries=entries,
        numbers=numbers,
        groups=_group_entries(entries),
        static_heading=HEADING_BY_GROUP["rest"],
        dt_s=dt_s,
        draw_actor_map=partial(draw_actor_map, map_frame),
        draw_charts=partial(draw_actor_charts, dt_s=dt_s),
        # a scenario uses other ids than the tracks of its log
        scenario_numbers=numbers | {name: numbers[id_] for id_, name in findings.names.items() if id_ in numbers},
        drift_chart=draw_drift_chart(findings.closeness.errors) if findings.closeness else None,
        MEDIAN_5S_M=MEDIAN_5S_M,
        infractions=draw_infractions(findings, entries, map_frame),
        deviation=draw_deviation(compute_deviation(findings), map_frame),
        deviation_rows=_list_deviations(findings.network),
        network_changes=_list_network_changes(findings.network).items(),
        cleaning_rows=_count_cleaning(findings),
        checks=[
            (describe_figure(check.figure)[0], f"{check.limit:g} {describe_figure(check.figure)[1]}", check.source)
            for check in CHECKS
        ],
    )


def _list_facts(findings: ConversionFindings) -> list[str]:
    recording, quality = findings.recording, findings.quality
    facts = [f"read as {recording.source}", f"{format_frames(quality.frames)}, {quality.frames * recording.dt_s:.1f} s"]
    if findings.window_s:
        facts.append(f"window {findings.window_s[0]:g} s to {findings.window_s[1]:g} s of the log")
    return [*facts, f"{len(quality.actors)} actors", f"network {findings.roads.name}", f"traffic {findings.mode}"]


class _Tile(NamedTuple):
    """A key figure at the head of the page; a missed target is labelled in words, too."""

    target: FidelityTarget
    value: str
    limit: str
    state: str
    """CSS class that colours the tile."""
    verdict: str


def _build_tiles(findings: ConversionFindings) -> list[_Tile]:
    quality, closeness = findings.quality, findings.closeness
    # shares as counts, because 95 % of 8 is a matter of one
    counts = {"moving vehicles passing all checks": f"{quality.moving_passed} of {quality.moving_vehicles}"}
    if closeness:
        counts["order kept at conflicts"] = f"{closeness.order_kept} of {closeness.order_pairs}"
    return [_build_tile(target, counts) for target in findings.targets]


def _build_tile(target: FidelityTarget, counts: Mapping[str, str]) -> _Tile:
    unit = target.unit.replace("m/s3", "m/s³")
    value = format_figure(target.value, unit, 2 if target.unit else 0)
    if target.value is not None and target.name in counts:
        value = counts[target.name]
    limit = f"{100 * target.limit:g} %" if unit == "share" else f"{target.limit:g} {unit}".strip()
    state = {True: "met", False: "missed", None: "open"}[target.met]
    return _Tile(target, value, limit, state, "not measured" if target.met is None else state)


def _group_entries(entries: Sequence[ReportEntry]) -> list[tuple[str, list[ReportEntry]]]:
    """Return the entries by heading, in the order of their first entry."""
    members: dict[str, list[ReportEntry]] = {}
    for entry in entries:
        members.setdefault(HEADING_BY_GROUP[entry.group], []).append(entry)
    return list(members.items())


def _format_thousandths(*values: float | None) -> Cells:
    return tuple(format_figure(value, decimals=3) for value in values)


def _list_deviations(network: NetworkReport) -> tuple[Cells, ...]:
    """Return the rows of the distances between the centre lines of the source and of the network [m]."""
    fit = network.deviation
    return (
        ("source to network", *_format_thousandths(fit.mean, fit.p95, fit.max)),
        ("network to source", *_format_thousandths(fit.back_mean, fit.back_p95, fit.back_max)),
        ("allowed", f"{CENTRE_LINES_MEAN_M:.3f}", f"{CENTRE_LINES_P95_M:.3f}", "–"),
    )


def _list_network_changes(network: NetworkReport) -> dict[str, list[str]]:
    """Return what was changed on the way from the map to the network, by what it means."""
    return {
        "lanes reversed: observed motion and links contradict the drawn direction": list(network.directions.inverted),
        "lanes of unknown direction, left as drawn": list(network.directions.undecided),
        "links added: ends that meet in one direction": [f"{a} → {b}" for a, b in network.links_added],
        "links dropped: no vehicle could follow them": [f"{a} → {b}" for a, b in network.links_dropped],
        "lanes not in the network": [f"{id_}: {reason}" for id_, reason in network.drop_reason_by_lane.items()],
        "lanes with traffic lights, whose program is unknown": list(network.signalled),
    }


def _count_cleaning(findings: ConversionFindings) -> list[Cells]:
    """Return a row for each reason of cleaning: what it means, the number of changes and of frames."""
    report = findings.cleaned.report
    changes = {reason: report.list_changes(reason) for reason in ChangeReason}
    return [
        (reason.value, CLEANING_ACTIONS.get(reason, ""), str(len(made)), str(sum(change.frames for change in made)))
        for reason, made in changes.items()
        if made
    ]
