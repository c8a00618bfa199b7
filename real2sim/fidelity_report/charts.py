"""Line charts of the report over time, in units of a tenth of a pixel, so that every coordinate is a whole number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from mdrive_sumo.core.geometry import Float, Int
from real2sim.fidelity_report.report_entry import ReportEntry
from real2sim.fidelity_report.svg import format_path, join_markup, render_picture, tag
from real2sim.quality import CHECKS
from real2sim.recording import RecordedTrack
from real2sim.tracks import kinematics
from real2sim.traffic_fidelity import MEDIAN_5S_M, PositionErrors

WIDTH, HEIGHT = 3600, 1700
LEFT, RIGHT, TOP, LOW = 400, 3500, 200, 1400
"""Edges of the plot area."""
TICKS = 4
"""Number of intervals between ticks that is aimed at: more would let the numbers of a small chart touch."""
LIMITS = {check.figure: check.limit for check in CHECKS}
MAX_SHOWN_ERROR_M = 2.0
"""[m] Upper limit of the error charts: twice the limit of the 95th percentile."""
MAX_SHOWN_DRIFT_M = 20.0
"""[m] Upper limit of the drift chart: an absent vehicle counts 100 m, which would flatten all other curves."""


@dataclass(frozen=True, slots=True)
class ChartSeries:
    """One line: x and y (N,), interrupted at NaN. With `upper` it is the band between y and `upper`."""

    class_: str
    x: Float
    y: Float
    upper: Float | None = None


@dataclass(frozen=True, slots=True)
class LineChart:
    """A chart with its axes; y begins at 0. Values above `top` are clipped."""

    label: str
    """What the chart shows, as text for screen readers."""
    title: str
    """What y is, with its unit."""
    series: Sequence[ChartSeries]
    x_range: tuple[float, float]
    top: float
    limits: Sequence[float] = ()
    """Values of y at which a horizontal line is drawn."""
    x_title: str = "time [s]"


def draw_chart(chart: LineChart) -> Markup:
    """Return the chart as SVG."""
    top = max(chart.top, 1e-6)
    x_ticks, y_ticks = _choose_ticks(*chart.x_range), _choose_ticks(0.0, top)
    grid = "".join(f"M{LEFT} {_y(y, top)}H{RIGHT}" for y in y_ticks)
    limits = "".join(f"M{LEFT} {_y(y, top)}H{RIGHT}" for y in chart.limits if y <= top)
    words = [_render_text(LEFT - 50, _y(y, top) + 40, f"{y:g}", "end") for y in y_ticks]
    words += [_render_text(_x(x, chart.x_range), LOW + 140, f"{x:g}", "middle") for x in x_ticks]
    words += [
        _render_text(LEFT, 120, chart.title, "start", "title"),
        _render_text(RIGHT, LOW + 270, chart.x_title, "end"),
    ]
    return render_picture(
        chart.label,
        f"0 0 {WIDTH} {HEIGHT}",
        tag("path", d=grid, class_="grid"),
        join_markup(_draw_series(series, chart.x_range, top) for series in chart.series),
        tag("path", d=limits, class_="limit") if limits else None,
        tag("g", *words),
        class_="chart",
    )


def _draw_series(series: ChartSeries, x_range: tuple[float, float], top: float) -> Markup:
    upper = series.upper
    drawable = np.isfinite(series.x) & np.isfinite(series.y)
    if upper is not None:
        drawable &= np.isfinite(upper)
    d = ""
    for run in kinematics.find_runs(drawable):
        x, y = series.x[run], series.y[run]
        if upper is not None:
            x, y = np.concatenate((x, x[::-1])), np.concatenate((y, upper[run][::-1]))
        d += format_path(_to_pixels(x, y, x_range, top)) + ("z" if upper is not None else "")
    return tag("path", d=d, class_=series.class_) if d else Markup("")


def _to_pixels(x: Float, y: Float, x_range: tuple[float, float], top: float) -> Int:
    first, last = x_range
    across = LEFT + (x - first) / max(last - first, 1e-9) * (RIGHT - LEFT)
    down = LOW - np.clip(y / top, 0.0, 1.03) * (LOW - TOP)
    return np.rint(np.column_stack((across, down))).astype(np.int64)


def _x(x: float, x_range: tuple[float, float]) -> int:
    return int(_to_pixels(np.array([x]), np.zeros(1), x_range, 1.0)[0, 0])


def _y(y: float, top: float) -> int:
    return round(LOW - y / top * (LOW - TOP))


def _render_text(x: int, y: int, text: str, anchor: str, class_: str | None = None) -> Markup:
    return tag("text", text, x=x, y=y, text_anchor=anchor, class_=class_)


def _choose_ticks(first: float, last: float) -> list[float]:
    """Return round values in the interval."""
    rough = max(last - first, 1e-6) / TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(power * next(m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= rough * 0.999))
    return [round(k * step, 6) for k in range(int(np.ceil(first / step - 1e-9)), int(last / step + 1e-9) + 1)]


def draw_actor_charts(entry: ReportEntry, dt_s: float) -> list[Markup]:
    """Return the charts of speed, distance to the log and jerk over time; none for static objects."""
    raw, track = entry.raw, entry.reconstructed
    if track is None or not entry.actor.moving or track.valid.sum() < 2:
        return []
    first, last = track.valid_frames[[0, -1]].tolist()
    axis = _TimeAxis((first * dt_s, last * dt_s), dt_s, f"of No. {entry.number}")
    charts = [_build_speed_chart(raw, track, axis)]
    if raw is not None:
        charts.append(_build_error_chart(raw, track, axis))
    charts.append(_build_jerk_chart(track, axis))
    return [draw_chart(chart) for chart in charts]


class _TimeAxis(NamedTuple):
    """The common axis of the charts of one actor."""

    span_s: tuple[float, float]
    """First and last time [s] of the axis."""
    dt_s: float
    """Time [s] from one frame to the next."""
    subject: str
    """Whose chart it is, for the label."""


def _build_speed_chart(raw: RecordedTrack | None, track: RecordedTrack, axis: _TimeAxis) -> LineChart:
    times, speed = compute_speeds(track, axis.dt_s)
    fastest = float(np.nanmax(speed, initial=0.0, where=np.isfinite(speed)))
    series = [ChartSeries("line", times, speed)]
    if raw is not None:
        series.insert(0, ChartSeries("raw-line", *compute_speeds(raw, axis.dt_s)))
    label = (
        f"Speed {axis.subject}: up to {fastest:.1f} m/s reconstructed; the thin line shows the differences of the log"
    )
    return LineChart(label, "speed [m/s]", series, axis.span_s, 1.4 * fastest + 1.0)


def _build_error_chart(raw: RecordedTrack, track: RecordedTrack, axis: _TimeAxis) -> LineChart:
    error = np.where(track.valid & raw.valid, kinematics.magnitude(track.xy - raw.xy), np.nan)
    most = float(np.nanmax(error, initial=0.0, where=np.isfinite(error)))
    limits = (LIMITS["error_median"], LIMITS["error_p95"])
    series = (ChartSeries("line", _times(len(error), axis.dt_s), error),)
    label = f"Distance {axis.subject} to the log: at most {most:.2f} m; {limits[0]:g} m is the limit of the median"
    return LineChart(
        label,
        "distance to the log [m]",
        series,
        axis.span_s,
        float(np.clip(1.2 * most, 0.4, MAX_SHOWN_ERROR_M)),
        limits,
    )


def _build_jerk_chart(track: RecordedTrack, axis: _TimeAxis) -> LineChart:
    jerk = np.full(len(track.valid), np.nan)
    half = kinematics.WINDOW // 2
    for run in kinematics.find_runs(track.valid):
        values = kinematics.jerk_magnitudes(track.xy[run], axis.dt_s)
        jerk[run.start + half : run.start + half + len(values)] = values
    most = float(np.nanmax(jerk, initial=0.0, where=np.isfinite(jerk)))
    limit = LIMITS["jerk_p95"]
    series = (ChartSeries("line", _times(len(jerk), axis.dt_s), jerk),)
    label = f"Jerk {axis.subject}: at most {most:.1f} m/s³; the limit of its 95th percentile is {limit:g} m/s³"
    return LineChart(
        label, "jerk [m/s³]", series, axis.span_s, float(np.clip(1.2 * most, 1.3 * limit, 4 * limit)), (limit,)
    )


def compute_speeds(track: RecordedTrack, dt_s: float) -> tuple[Float, Float]:
    """Return times (T-1,) [s] between frames and speeds from the steps; NaN over gaps."""
    step = np.hypot(np.diff(track.x), np.diff(track.y)) / dt_s
    there = track.valid[1:] & track.valid[:-1]
    return _times(len(step), dt_s) + 0.5 * dt_s, np.where(there, step, np.nan)


def _times(frames: int, dt_s: float) -> Float:
    return np.arange(frames, dtype=np.float64) * dt_s


def draw_drift_chart(errors: Sequence[PositionErrors]) -> Markup:
    """Return the chart of how far the traffic is from the log over the time since departure."""
    lower, median, upper = (_values(errors, name) for name in ("lower", "median", "upper"))
    times = np.array([error.after_s for error in errors], dtype=np.float64)
    measured = times[np.isfinite(median)]
    span = (float(measured[0]), float(measured[-1])) if len(measured) > 1 else (0.0, 1.0)
    most = float(np.nanmax(upper, initial=0.0, where=np.isfinite(upper)))
    top = float(np.clip(1.15 * most, 1.2 * MEDIAN_5S_M, MAX_SHOWN_DRIFT_M))
    series = (ChartSeries("band", times, lower, upper), ChartSeries("line", times, median))
    label = "Distance between simulated and logged vehicles over time since departure: median, and quartiles as a band"
    title = "distance to the log [m]: median and quartiles"
    return draw_chart(LineChart(label, title, series, span, top, (MEDIAN_5S_M,), "time since departure [s]"))


def _values(errors: Sequence[PositionErrors], name: str) -> Float:
    values = [getattr(error, name) for error in errors]
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
