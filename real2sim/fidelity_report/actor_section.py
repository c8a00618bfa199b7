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
HEAD = ("No.", "thing", "verdict", "in SUMO", "cleaning", "frames", "median [m]", "p95 [m]", "jerk p95 [m/s³]")
GROUPS = {
    "fail": "Fails a check",
    "cav": "CAVs",
    "pass": "Moving vehicles that pass",
    "walk": "On foot or cycle, passing",
    "rest": "Standing and passing",
}
"""Headings by verdict class."""
ERRORS_SHOWN_M = 2.0
"""[m] Upper limit of the error charts."""


@dataclass(frozen=True)
class ActorSection:
    """Data of the actor section."""

    things: Sequence[ReportEntry]
    plan: MapFrame
    dt_s: float
    changes: Mapping[str, Sequence[TrackChange]]
    """By track."""


def gather_actors(findings: ConversionFindings, things: Sequence[ReportEntry], plan: MapFrame) -> ActorSection:
    """Group the cleaning changes by track."""
    changes: dict[str, list[TrackChange]] = {}
    for change in findings.cleaned.report.changes:
        changes.setdefault(change.track, []).append(change)
    return ActorSection(things, plan, findings.cleaned.dt_s, changes)


def render_actor_table(page: ActorSection) -> Markup:
    """Return the table of all actors, failing ones first."""
    return render_table(HEAD, (_row(page, thing) for thing in page.things), "All actors", text_columns=5)


def _row(page: ActorSection, thing: ReportEntry) -> tuple[Markup | str, ...]:
    actor = thing.actor
    count = len(page.changes.get(actor.id, ()))
    return (
        tag("a", str(thing.number), href=f"#thing-{thing.number}"),
        join_markup((_what(thing), tag("code", actor.id, class_="id"))),
        _verdict(thing),
        _role(thing),
        f"{count} change{'' if count == 1 else 's'}" if count else "",
        str(actor.frames),
        format_figure(actor.error_median),
        format_figure(actor.error_p95),
        format_figure(actor.jerk_p95, decimals=1) if actor.moving else "–",
    )


def _what(thing: ReportEntry) -> Markup:
    actor = thing.actor
    badge = tag("span", "CAV", class_="badge cav") if thing.cav else None
    return tag("span", actor.category, "" if actor.moving else ", stands", " ", badge)


def _verdict(thing: ReportEntry) -> Markup:
    if not thing.actor.failed:
        return tag("span", "passes", class_="badge pass")
    return join_markup((tag("span", "fails", class_="badge fail"), render_list(describe_failures(thing.actor))))


def _role(thing: ReportEntry) -> Markup | str:
    role = thing.role
    if role is None:
        return "–"
    return join_markup((role.disposition.value, tag("small", role.reason) if role.reason else None), " ")


def render_actor_cards(page: ActorSection) -> Markup:
    """Return a collapsible card for each actor; failing ones are open, static ones are in a collapsed group."""
    groups: dict[str, list[ReportEntry]] = {}
    for thing in page.things:
        groups.setdefault(GROUPS["fail" if thing.actor.failed else "cav" if thing.cav else thing.look], []).append(
            thing
        )
    return join_markup((_group(page, name, things) for name, things in groups.items()), "\n")


def _group(page: ActorSection, name: str, things: Sequence[ReportEntry]) -> Markup:
    cards = join_markup((_card(page, thing) for thing in things), "\n")
    title = f"{name} ({len(things)})"
    if name == GROUPS["rest"]:
        return tag("details", tag("summary", tag("h3", title)), cards, class_="group")
    return tag("div", tag("h3", title), cards, class_="group")


def _card(page: ActorSection, thing: ReportEntry) -> Markup:
    actor = thing.actor
    failed = f"fails {len(actor.failed)}" if actor.failed else "passes"
    title = (
        tag("b", f"No. {thing.number}", id=f"thing-{thing.number}"),
        tag("span", failed, class_=f"badge {'fail' if actor.failed else 'pass'}"),
        _what(thing),
        tag("code", actor.id, class_="id"),
    )
    facts = tag("div", _facts(page, thing), class_="facts")
    charts = tag("div", *_charts(page, thing), class_="charts")
    content = tag("div", facts, draw_actor_map(page.plan, thing), charts, class_="card-body")
    return tag(
        "details", tag("summary", join_markup(title, " ")), content, class_="card", open="" if actor.failed else None
    )


def _facts(page: ActorSection, thing: ReportEntry) -> Markup:
    actor = thing.actor
    cleaned = describe_changes(page.changes.get(actor.id, ()), actor.id)
    facts: list[tuple[str, Markup | str]] = [
        ("Seen", f"{format_frames(actor.frames)}{_seconds(page, thing)}{f', {actor.gaps} gaps' if actor.gaps else ''}"),
        ("Became", _role(thing)),
        ("Fails", render_list(describe_failures(actor)) if actor.failed else "nothing"),
        ("Cleaning", render_list(cleaned) if cleaned else "changed nothing"),
    ]
    if actor.error_median is not None:
        distance = f"median {format_figure(actor.error_median, 'm')}, p95 {format_figure(actor.error_p95, 'm')}"
        facts.append(("To the log", f"{distance}, at most {format_figure(actor.error_max, 'm')}"))
    return tag("dl", *(join_markup((tag("dt", name), tag("dd", fact))) for name, fact in facts))


def _seconds(page: ActorSection, thing: ReportEntry) -> str:
    known = thing.known
    if known is None or not known.valid.any():
        return ""
    return f" from {known.valid_frames[0] * page.dt_s:.1f} s to {known.valid_frames[-1] * page.dt_s:.1f} s"


def _charts(page: ActorSection, thing: ReportEntry) -> list[Markup]:
    """Return the charts of speed, distance to the log and jerk over time; none for static objects."""
    raw, track = thing.raw, thing.track
    if track is None or not thing.actor.moving or track.valid.sum() < 2:
        return []
    span = (track.valid_frames[0] * page.dt_s, track.valid_frames[-1] * page.dt_s)
    name = f"of No. {thing.number}"
    charts = [_speed_chart(raw, track, (span, page.dt_s, name))]
    if raw is not None:
        charts.append(_error_chart(raw, track, (span, page.dt_s, name)))
    charts.append(_jerk_chart(track, (span, page.dt_s, name)))
    return [draw_chart(chart) for chart in charts]


Axis = tuple[tuple[float, float], float, str]
"""First and last second, seconds per frame, and the subject of the label."""


def _speed_chart(raw: RecordedTrack | None, track: RecordedTrack, axis: Axis) -> LineChart:
    span, dt_s, name = axis
    times, speed = speeds(track, dt_s)
    fastest = float(np.nanmax(speed, initial=0.0, where=np.isfinite(speed)))
    series = [ChartSeries("line", times, speed)]
    if raw is not None:
        series.insert(0, ChartSeries("raw-line", *speeds(raw, dt_s)))
    label = f"Speed {name}: up to {fastest:.1f} m/s reconstructed; the log's own differences are drawn behind it"
    return LineChart(label, "speed [m/s]", series, span, 1.4 * fastest + 1.0)


def _error_chart(raw: RecordedTrack, track: RecordedTrack, axis: Axis) -> LineChart:
    span, dt_s, name = axis
    error = np.where(track.valid & raw.valid, kinematics.magnitude(track.xy - raw.xy), np.nan)
    most = float(np.nanmax(error, initial=0.0, where=np.isfinite(error)))
    limits = (LIMITS["error_median"], LIMITS["error_p95"])
    series = (ChartSeries("line", _times(len(error), dt_s), error),)
    label = f"Distance {name} to the log: at most {most:.2f} m; {limits[0]:g} m is allowed in the median"
    return LineChart(
        label, "distance to the log [m]", series, span, float(np.clip(1.2 * most, 0.4, ERRORS_SHOWN_M)), limits
    )


def _jerk_chart(track: RecordedTrack, axis: Axis) -> LineChart:
    span, dt_s, name = axis
    jerk = np.full(len(track.valid), np.nan)
    half = kinematics.WINDOW // 2
    for run in kinematics.find_runs(track.valid):
        values = kinematics.jerk_magnitudes(track.xy[run], dt_s)
        jerk[run.start + half : run.start + half + len(values)] = values
    most = float(np.nanmax(jerk, initial=0.0, where=np.isfinite(jerk)))
    limit = LIMITS["jerk_p95"]
    series = (ChartSeries("line", _times(len(jerk), dt_s), jerk),)
    label = f"Jerk {name}: at most {most:.1f} m/s³; 95 % of it may not exceed {limit:g} m/s³"
    return LineChart(label, "jerk [m/s³]", series, span, float(np.clip(1.2 * most, 1.3 * limit, 4 * limit)), (limit,))


def speeds(track: RecordedTrack, dt_s: float) -> tuple[Float, Float]:
    """Return times (T-1,) [s] between frames and speeds from the steps; NaN over gaps."""
    step = np.hypot(np.diff(track.x), np.diff(track.y)) / dt_s
    there = track.valid[1:] & track.valid[:-1]
    return _times(len(step), dt_s) + 0.5 * dt_s, np.where(there, step, np.nan)


def _times(frames: int, dt_s: float) -> Float:
    return np.arange(frames, dtype=np.float64) * dt_s
