"""Geometry of the charts on the pages; the template `charts.html` draws them as SVG without scripts and styles."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from server.clock import DAY_US
from server.web.templating import format_day

SPARKLINE_POINTS = 30
"""Results of a sparkline, the latest: more would be less than 3 pixels apart."""
_SPARK_WIDTH, _SPARK_HEIGHT = 90, 22
"""Size of a sparkline [pixels]; chosen to fit into a line of the table."""
_SPARK_MIN_SPAN = 10.0
"""Smallest difference of values that fills the height: smaller ones are drawn flatter."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 12, 10, 24
"""Margins of the history in it [pixels], for the labels of both axes."""
_WIDTH, _HEIGHT = 720, 240
"""Size of the history [pixels]."""
_BARS_WIDTH, _BARS_HEIGHT, _BARS_FOOT, _BARS_HEAD = 640, 190, 34, 18
"""Size of the histogram, and of the labels below and above its bars [pixels]."""


@dataclass(frozen=True, slots=True)
class ChartPoint:
    """A result at a time [us since 1970]."""

    at_us: int
    value: float
    """Driving score [%], 0 .. 100."""
    low: float | None
    high: float | None
    label: str
    series: str
    """Points of one series are joined."""


@dataclass(frozen=True, slots=True)
class Sparkline:
    """A small line chart; `points` are pixels, the last one is marked."""

    points: Sequence[tuple[float, float]]
    label: str
    width: int = _SPARK_WIDTH
    height: int = _SPARK_HEIGHT


@dataclass(frozen=True, slots=True)
class HistoryChart:
    """Results over time in pixels, each with its interval."""

    label: str
    scale: Sequence[tuple[float, int]]
    """y [pixels] and value [%] of each horizontal line."""
    intervals: Sequence[tuple[float, float, float]]
    """x, and y of the low and of the high end, of the interval of each result [pixels]."""
    lines: Sequence[Sequence[tuple[float, float]]]
    dots: Sequence[tuple[float, float, str]]
    """x and y of each result [pixels], and its tooltip."""
    days: Sequence[tuple[float, str, str]]
    """x [pixels], text-anchor and text of each label of the axis of time."""
    width: int = _WIDTH
    height: int = _HEIGHT
    left: int = _LEFT
    right: int = _WIDTH - _RIGHT


@dataclass(frozen=True, slots=True)
class HistogramBar:
    """One class of a histogram in pixels."""

    x: float
    y: float
    width: float
    height: float
    label: str
    """The reply times that it counts, as text."""
    short: str
    """Short label below the bar."""
    count: int


@dataclass(frozen=True, slots=True)
class LatencyHistogram:
    """Histogram of reply times."""

    bars: tuple[HistogramBar, ...]
    total: int
    median: str
    """The class of reply times in which the median is, as text."""
    width: int = _BARS_WIDTH
    height: int = _BARS_HEIGHT
    ground: int = _BARS_HEIGHT - _BARS_FOOT


def make_sparkline(values: Sequence[float]) -> Sparkline:
    """Return a sparkline of the last DS values, on a scale of its own. Needs at least one value."""
    last = values[-SPARKLINE_POINTS:]
    middle = (min(last) + max(last)) / 2
    span = max(max(last) - min(last), _SPARK_MIN_SPAN)
    step = (_SPARK_WIDTH - 6) / max(len(last) - 1, 1)
    points = [
        (3 + step * n, _SPARK_HEIGHT / 2 - (_SPARK_HEIGHT - 6) * (value - middle) / span)
        for n, value in enumerate(last)
    ]
    label = f"DS of {len(values)} submissions, the first {values[0]:.1f}, the last {values[-1]:.1f}"
    return Sparkline(points, label if len(values) > 1 else f"DS of one submission: {values[0]:.1f}")


def make_history(points: Sequence[ChartPoint], label: str) -> HistoryChart:
    """Return a chart of results over time, the oldest first. Needs at least one point."""
    first_us, last_us = points[0].at_us, points[-1].at_us
    span_us = max(last_us - first_us, 1)
    width, height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x(at_us: int) -> float:
        return _LEFT + width / 2 if first_us == last_us else _LEFT + width * (at_us - first_us) / span_us

    def y(value: float) -> float:
        return _TOP + height * (1 - value / 100)

    lines: dict[str, list[tuple[float, float]]] = {}
    for point in points:
        lines.setdefault(point.series, []).append((x(point.at_us), y(point.value)))
    return HistoryChart(
        label=label,
        scale=[(y(value), value) for value in (0, 25, 50, 75, 100)],
        intervals=[
            (x(point.at_us), y(point.low), y(point.high))
            for point in points
            if point.low is not None and point.high is not None
        ],
        lines=list(lines.values()),
        dots=[
            (x(point.at_us), y(point.value), f"{point.label}: DS {point.value:.1f}, {format_day(point.at_us)}")
            for point in points
        ],
        days=_make_days(first_us, last_us),
    )


def _make_days(first_us: int, last_us: int) -> list[tuple[float, str, str]]:
    if first_us // DAY_US == last_us // DAY_US:
        return [(_LEFT + (_WIDTH - _LEFT - _RIGHT) / 2, "middle", format_day(first_us))]
    return [(_LEFT, "start", format_day(first_us)), (_WIDTH - _RIGHT, "end", format_day(last_us))]


def make_latency_histogram(usages: Iterable[Mapping[str, Any] | None]) -> LatencyHistogram | None:
    """Return the sum of `usage["latency"]` over scenarios; None without any reply.

    Skips scenarios whose classes differ from those of the first.
    """
    ends: list[float] = []
    counts: list[int] = []
    for usage in usages:
        latency = (usage or {}).get("latency")
        if not latency or not latency["counts"] or (ends and latency["ends_ms"] != ends):
            continue
        ends = latency["ends_ms"]
        counts = [a + b for a, b in zip(counts or [0] * len(latency["counts"]), latency["counts"], strict=True)]
    if not sum(counts):
        return None
    labels = [*(f"≤ {_format_ms(end)}" for end in ends), f"> {_format_ms(ends[-1])}"]
    width, height = _BARS_WIDTH / len(counts), _BARS_HEIGHT - _BARS_FOOT - _BARS_HEAD
    bars: list[HistogramBar] = []
    for i, (label, count) in enumerate(zip(labels, counts, strict=True)):
        size = height * count / max(counts)
        x, y = round(i * width + 3, 1), round(_BARS_HEIGHT - _BARS_FOOT - size, 1)
        bars.append(HistogramBar(x, y, round(width - 6, 1), round(size, 1), label, label.removesuffix(" ms"), count))
    return LatencyHistogram(tuple(bars), sum(counts), labels[_find_median_class(counts)])


def _format_ms(milliseconds: float) -> str:
    return f"{milliseconds / 1000:g} s" if milliseconds >= 1000 else f"{milliseconds:g} ms"


def _find_median_class(counts: list[int]) -> int:
    total, half = 0, sum(counts) / 2
    for index, count in enumerate(counts):
        total += count
        if total >= half:
            return index
    return len(counts) - 1
