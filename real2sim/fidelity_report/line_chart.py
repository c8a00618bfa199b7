"""Small line charts over time, in units of a tenth of a pixel, so that every coordinate is a whole number."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from real2sim.fidelity_report.html import Markup, join_markup, tag
from real2sim.fidelity_report.svg import format_path, render_picture
from real2sim.tracks.kinematics import find_runs

WIDTH, HEIGHT = 3600, 1700
LEFT, RIGHT, TOP, LOW = 400, 3500, 200, 1400
"""Edges of the plot area."""
TICKS = 4


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
    """Text for screen readers."""
    title: str
    """Includes the unit of y."""
    series: Sequence[ChartSeries]
    x_range: tuple[float, float]
    top: float
    limits: Sequence[float] = ()
    """Horizontal lines."""
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
    known = np.isfinite(series.x) & np.isfinite(series.y)
    if upper is not None:
        known &= np.isfinite(upper)
    d = ""
    for run in find_runs(known):
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
