"""Report section on actors: a table of all, and for each its verdict, pictures, charts and cleaning changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from real2sim.clean.cleaning_report import TrackChange
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import describe_changes, describe_failures, format_figure, format_frames
from real2sim.fidelity_report.html import Markup, join_markup, render_list, render_table, tag
from real2sim.fidelity_report.line_chart import ChartSeries, LineChart, draw_chart
from real2sim.fidelity_report.map_figures import MapFrame, draw_actor_map
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.quality import CHECKS
from real2sim.recording import RecordedTrack
from real2sim.tracks import kinematics

LIMITS = {check.figure: check.limit for check in CHECKS}
HEAD = ("No.", "actor", "verdict", "in SUMO", "cleaning", "frames", "median [m]", "p95 [m]", "jerk p95 [m/s³]")
GROUPS = {
    "fail": "Fails a check",
    "cav": "CAVs",
    "pass": "Moving vehicles that pass",
    "walk": "Pedestrians and cyclists that pass",
    "rest": "Static objects that pass",
}
"""Headings by verdict class."""
MAX_SHOWN_ERROR_M = 2.0
"""[m] Upper limit of the error charts."""


@dataclass(frozen=True)
class ActorSection:
    """Data of the actor section."""

    entries: Sequence[ReportEntry]
    map_frame: MapFrame
    dt_s: float
    changes: Mapping[str, Sequence[TrackChange]]
    """By track."""


def gather_actors(findings: ConversionFindings, entries: Sequence[ReportEntry], map_frame: MapFrame) -> ActorSection:
    """Group the cleaning changes by track."""
    changes: dict[str, list[TrackChange]] = {}
    for change in findings.cleaned.report.changes:
        changes.setdefault(change.track, []).append(change)
    return ActorSection(entries, map_frame, findings.cleaned.dt_s, changes)


def render_actor_table(section: ActorSection) -> Markup:
    """Return the table of all actors, failing ones first."""
    return render_table(HEAD, (_table_row(section, entry) for entry in section.entries), "All actors", text_columns=5)


def _table_row(section: ActorSection, entry: ReportEntry) -> tuple[Markup | str, ...]:
    actor = entry.actor
    count = len(section.changes.get(actor.id, ()))
    return (
        tag("a", str(entry.number), href=f"#actor-{entry.number}"),
        join_markup((_describe_actor(entry), tag("code", actor.id, class_="id"))),
        _render_verdict(entry),
        _render_role(entry),
        f"{count} change{'' if count == 1 else 's'}" if count else "",
        str(actor.frames),
        format_figure(actor.error_median),
        format_figure(actor.error_p95),
        format_figure(actor.jerk_p95, decimals=1) if actor.moving else "–",
    )


def _describe_actor(entry: ReportEntry) -> Markup:
    actor = entry.actor
    badge = tag("span", "CAV", class_="badge cav") if entry.is_cav else None
    return tag("span", actor.category, "" if actor.moving else ", static", " ", badge)


def _render_verdict(entry: ReportEntry) -> Markup:
    if not entry.actor.failed:
        return tag("span", "passes", class_="badge pass")
    return join_markup((tag("span", "fails", class_="badge fail"), render_list(describe_failures(entry.actor))))


def _render_role(entry: ReportEntry) -> Markup | str:
    role = entry.role
    if role is None:
        return "–"
    return join_markup((role.disposition.value, tag("small", role.reason) if role.reason else None), " ")


def render_actor_cards(section: ActorSection) -> Markup:
    """Return a collapsible card for each actor; failing ones are open, static ones are in a collapsed group."""
    groups: dict[str, list[ReportEntry]] = {}
    for entry in section.entries:
        groups.setdefault(
            GROUPS["fail" if entry.actor.failed else "cav" if entry.is_cav else entry.verdict_class], []
        ).append(entry)
    return join_markup((_render_group(section, name, entries) for name, entries in groups.items()), "\n")


def _render_group(section: ActorSection, name: str, entries: Sequence[ReportEntry]) -> Markup:
    cards = join_markup((_render_card(section, entry) for entry in entries), "\n")
    title = f"{name} ({len(entries)})"
    if name == GROUPS["rest"]:
        return tag("details", tag("summary", tag("h3", title)), cards, class_="group")
    return tag("div", tag("h3", title), cards, class_="group")


def _render_card(section: ActorSection, entry: ReportEntry) -> Markup:
    actor = entry.actor
    failed = f"fails {len(actor.failed)}" if actor.failed else "passes"
    title = (
        tag("b", f"No. {entry.number}", id=f"actor-{entry.number}"),
        tag("span", failed, class_=f"badge {'fail' if actor.failed else 'pass'}"),
        _describe_actor(entry),
        tag("code", actor.id, class_="id"),
    )
    facts = tag("div", _render_facts(section, entry), class_="facts")
    charts = tag("div", *_draw_charts(section, entry), class_="charts")
    content = tag("div", facts, draw_actor_map(section.map_frame, entry), charts, class_="card-body")
    return tag(
        "details", tag("summary", join_markup(title, " ")), content, class_="card", open="" if actor.failed else None
    )


def _render_facts(section: ActorSection, entry: ReportEntry) -> Markup:
    actor = entry.actor
    cleaned = describe_changes(section.changes.get(actor.id, ()), actor.id)
    gaps = f", {actor.gaps} gaps" if actor.gaps else ""
    facts: list[tuple[str, Markup | str]] = [
        ("Present", format_frames(actor.frames) + _format_time_span(section, entry) + gaps),
        ("Becomes", _render_role(entry)),
        ("Fails", render_list(describe_failures(actor)) if actor.failed else "nothing"),
        ("Cleaning", render_list(cleaned) if cleaned else "changed nothing"),
    ]
    if actor.error_median is not None:
        distance = f"median {format_figure(actor.error_median, 'm')}, p95 {format_figure(actor.error_p95, 'm')}"
        facts.append(("Distance to the log", f"{distance}, at most {format_figure(actor.error_max, 'm')}"))
    return tag("dl", *(join_markup((tag("dt", name), tag("dd", fact))) for name, fact in facts))


def _format_time_span(section: ActorSection, entry: ReportEntry) -> str:
    known = entry.best_track
    if known is None or not known.valid.any():
        return ""
    return f" from {known.valid_frames[0] * section.dt_s:.1f} s to {known.valid_frames[-1] * section.dt_s:.1f} s"


def _draw_charts(section: ActorSection, entry: ReportEntry) -> list[Markup]:
    """Return the charts of speed, distance to the log and jerk over time; none for static objects."""
    raw, track = entry.raw, entry.reconstructed
    if track is None or not entry.actor.moving or track.valid.sum() < 2:
        return []
    span = (track.valid_frames[0] * section.dt_s, track.valid_frames[-1] * section.dt_s)
    name = f"of No. {entry.number}"
    charts = [_build_speed_chart(raw, track, (span, section.dt_s, name))]
    if raw is not None:
        charts.append(_build_error_chart(raw, track, (span, section.dt_s, name)))
    charts.append(_build_jerk_chart(track, (span, section.dt_s, name)))
    return [draw_chart(chart) for chart in charts]


ChartAxis = tuple[tuple[float, float], float, str]
"""First and last second, seconds per frame, and the subject of the label."""


def _build_speed_chart(raw: RecordedTrack | None, track: RecordedTrack, axis: ChartAxis) -> LineChart:
    span, dt_s, name = axis
    times, speed = compute_speeds(track, dt_s)
    fastest = float(np.nanmax(speed, initial=0.0, where=np.isfinite(speed)))
    series = [ChartSeries("line", times, speed)]
    if raw is not None:
        series.insert(0, ChartSeries("raw-line", *compute_speeds(raw, dt_s)))
    label = f"Speed {name}: up to {fastest:.1f} m/s reconstructed; the thin line shows the differences of the log"
    return LineChart(label, "speed [m/s]", series, span, 1.4 * fastest + 1.0)


def _build_error_chart(raw: RecordedTrack, track: RecordedTrack, axis: ChartAxis) -> LineChart:
    span, dt_s, name = axis
    error = np.where(track.valid & raw.valid, kinematics.magnitude(track.xy - raw.xy), np.nan)
    most = float(np.nanmax(error, initial=0.0, where=np.isfinite(error)))
    limits = (LIMITS["error_median"], LIMITS["error_p95"])
    series = (ChartSeries("line", _times(len(error), dt_s), error),)
    label = f"Distance {name} to the log: at most {most:.2f} m; {limits[0]:g} m is the limit of the median"
    return LineChart(
        label, "distance to the log [m]", series, span, float(np.clip(1.2 * most, 0.4, MAX_SHOWN_ERROR_M)), limits
    )


def _build_jerk_chart(track: RecordedTrack, axis: ChartAxis) -> LineChart:
    span, dt_s, name = axis
    jerk = np.full(len(track.valid), np.nan)
    half = kinematics.WINDOW // 2
    for run in kinematics.find_runs(track.valid):
        values = kinematics.jerk_magnitudes(track.xy[run], dt_s)
        jerk[run.start + half : run.start + half + len(values)] = values
    most = float(np.nanmax(jerk, initial=0.0, where=np.isfinite(jerk)))
    limit = LIMITS["jerk_p95"]
    series = (ChartSeries("line", _times(len(jerk), dt_s), jerk),)
    label = f"Jerk {name}: at most {most:.1f} m/s³; the limit of its 95th percentile is {limit:g} m/s³"
    return LineChart(label, "jerk [m/s³]", series, span, float(np.clip(1.2 * most, 1.3 * limit, 4 * limit)), (limit,))


def compute_speeds(track: RecordedTrack, dt_s: float) -> tuple[Float, Float]:
    """Return times (T-1,) [s] between frames and speeds from the steps; NaN over gaps."""
    step = np.hypot(np.diff(track.x), np.diff(track.y)) / dt_s
    there = track.valid[1:] & track.valid[:-1]
    return _times(len(step), dt_s) + 0.5 * dt_s, np.where(there, step, np.nan)


def _times(frames: int, dt_s: float) -> Float:
    return np.arange(frames, dtype=np.float64) * dt_s
