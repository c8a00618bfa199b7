"""Small drawings in SVG, made here: no script, and no style but by classes of the style sheet."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from server.web.templating import format_day

_SPARK_W, _SPARK_H, _SPARK_POINTS = 90, 22, 30
_SPARK_SPAN = 10.0
"""What differs by less is drawn flatter."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 34, 12, 10, 24
_WIDTH, _HEIGHT = 720, 240
_DAY_US = 86_400_000_000


@dataclass(frozen=True, slots=True)
class ChartPoint:
    """A result at a time."""

    at_us: int
    value: float
    """0 .. 100."""
    low: float | None
    high: float | None
    label: str
    series: str
    """Points of the same one are joined."""


def bar(value: float, low: float | None, high: float | None) -> Markup:
    """A value of 0 .. 100 with its interval. The numbers stand beside it, so it is hidden from screen readers."""
    span = ""
    if low is not None and high is not None:
        span = f'<line class="draw-line" x1="{low:.1f}" y1="5" x2="{high:.1f}" y2="5"/>'
    return Markup(
        '<svg class="interval" aria-hidden="true" viewBox="0 0 100 10" width="100" height="10">'
        '<line class="draw-axis" x1="0" y1="9.5" x2="100" y2="9.5"/>'
        f'<rect class="draw-area" x="0" y="1" width="{value:.1f}" height="8"/>'
        f'{span}<rect class="draw-dot" x="{value - 1:.1f}" y="0" width="2" height="10"/></svg>'
    )


def sparkline(values: Sequence[float], what: str = "DS") -> Markup:
    """The last of some values over time, on a scale of their own; words say the same."""
    last = values[-_SPARK_POINTS:]
    middle = (min(last) + max(last)) / 2
    span = max(max(last) - min(last), _SPARK_SPAN)
    step = (_SPARK_W - 6) / max(len(last) - 1, 1)
    places = [(3 + step * n, _SPARK_H / 2 - (_SPARK_H - 6) * (value - middle) / span) for n, value in enumerate(last)]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    said = f"{what} of {len(values)} submissions, the first {values[0]:.1f}, the last {values[-1]:.1f}"
    if len(values) == 1:
        said = f"{what} of one submission: {values[0]:.1f}"
    x, y = places[-1]
    return Markup(
        f'<svg class="spark" role="img" aria-label="{said}" viewBox="0 0 {_SPARK_W} {_SPARK_H}" width="{_SPARK_W}"'
        f' height="{_SPARK_H}"><polyline class="draw-line" points="{points}"/>'
        f'<circle class="draw-dot" cx="{x:.1f}" cy="{y:.1f}" r="2.4"/></svg>'
    )


def history(points: Sequence[ChartPoint], said: str) -> Markup:
    """Results over time, the oldest first, each with its interval; what it shows also stands in a table. Needs one."""
    first_us, last_us = points[0].at_us, points[-1].at_us
    whole_us = max(last_us - first_us, 1)
    wide, tall = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x(at_us: int) -> float:
        return _LEFT + wide / 2 if first_us == last_us else _LEFT + wide * (at_us - first_us) / whole_us

    def y(value: float) -> float:
        return _TOP + tall * (1 - value / 100)

    made = [_scale(y(value), value) for value in (0, 25, 50, 75, 100)]
    made += [
        Markup('<line class="draw-span" x1="{0:.1f}" y1="{1:.1f}" x2="{0:.1f}" y2="{2:.1f}"/>').format(
            x(each.at_us), y(each.low), y(each.high)
        )
        for each in points
        if each.low is not None and each.high is not None
    ]
    for series in dict.fromkeys(each.series for each in points):
        line = " ".join(f"{x(each.at_us):.1f},{y(each.value):.1f}" for each in points if each.series == series)
        made.append(Markup('<polyline class="draw-line" points="{}"/>').format(line))
    made += [
        Markup('<circle class="draw-dot" cx="{:.1f}" cy="{:.1f}" r="3.5"><title>{}</title></circle>').format(
            x(each.at_us), y(each.value), f"{each.label}: DS {each.value:.1f}, {format_day(each.at_us)}"
        )
        for each in points
    ]
    made += _days(first_us, last_us)
    head = Markup('<svg class="history" role="img" aria-label="{}" viewBox="0 0 {} {}">').format(said, _WIDTH, _HEIGHT)
    return Markup("").join((head, *made, Markup("</svg>")))


def _scale(y: float, value: int) -> Markup:
    return Markup(
        '<line class="draw-axis" x1="{left}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}"/>'
        '<text class="draw-text" x="{text}" y="{base:.1f}" text-anchor="end">{value}</text>'
    ).format(left=_LEFT, right=_WIDTH - _RIGHT, y=y, text=_LEFT - 6, base=y + 4, value=value)


def _days(first_us: int, last_us: int) -> list[Markup]:
    text = Markup('<text class="draw-text" x="{}" y="{}" text-anchor="{}">{}</text>')
    base = _HEIGHT - 6
    if first_us // _DAY_US == last_us // _DAY_US:
        return [text.format(_LEFT + (_WIDTH - _LEFT - _RIGHT) / 2, base, "middle", format_day(first_us))]
    return [
        text.format(_LEFT, base, "start", format_day(first_us)),
        text.format(_WIDTH - _RIGHT, base, "end", format_day(last_us)),
    ]
