"""SVG drawing in the world frame: metres become whole centimetres from one corner of the map, y downwards."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.report.map_view import MapView
from real2sim.tracks.kinematics import find_runs

SvgValue = str | int | float | None
"""Content of an element or value of an attribute: `Markup` is kept, other text is escaped, None is omitted."""
CM = 100.0
"""Units of the pictures per metre: whole centimetres are finer than any screen shows, and short as text."""
NOSE = 0.35
"""Distance from the tip of a drawn vehicle to its shoulders, as a share of its width."""


@dataclass(frozen=True, slots=True)
class SvgFrame:
    """Conversion from the world frame to SVG coordinates; `left` and `high` [m] are the origin."""

    left: float
    high: float

    def to_cm(self, xy: Float) -> Int:
        """Return points (N, 2) in whole centimetres (N, 2)."""
        return np.rint((xy - (self.left, self.high)) * (CM, -CM)).astype(np.int64)

    def line_path(self, xy: Float, valid: Bool | None = None) -> str:
        """Return the path of a line (N, 2), interrupted at invalid rows."""
        there = np.asarray(np.isfinite(xy).all(axis=1)) if valid is None else valid
        return "".join(format_path(self.to_cm(xy[run])) for run in find_runs(there))

    def dots_path(self, xy: Float) -> str:
        """Return the path of points (N, 2): strokes of zero length, which round caps turn into dots."""
        points = self.to_cm(xy[np.isfinite(xy).all(axis=1)])
        if not len(points):
            return ""
        points = points[np.append(True, (np.diff(points, axis=0) != 0).any(1))]
        return f"M{_format_point(points[0])}h0" + "".join(
            f"m{_format_point(step)}h0" for step in np.diff(points, axis=0)
        )

    def area_path(self, xy: Float) -> str:
        """Return the path around an area (N, 2)."""
        return format_path(self.to_cm(xy)) + "z"

    def vehicle_path(self, pose: Sequence[float], length: float, width: float) -> str:
        """Return the path of a box with a pointed front; pose is x, y, yaw of its centre."""
        x, y, yaw = pose
        nose = min(NOSE * width, length / 2)
        ahead = np.array((length / 2 - nose, -length / 2, -length / 2, length / 2 - nose, length / 2))
        left = np.array((width, width, -width, -width, 0.0)) / 2
        cos, sin = np.cos(yaw), np.sin(yaw)
        return self.area_path(np.column_stack((x + ahead * cos - left * sin, y + ahead * sin + left * cos)))

    def view_box_attribute(self, view: MapView) -> str:
        """Return the viewBox attribute of a view."""
        x, y = self.to_cm(np.array([[view.left, view.high]]))[0]
        width, height = view.size
        return f"{x} {y} {width * CM:.0f} {height * CM:.0f}"


def format_path(points: Int) -> str:
    """Return the path of a line through points (N, 2) in whole units; repeated points are left out."""
    steps = np.diff(points, axis=0)
    steps = steps[(steps != 0).any(1)]
    return f"M{_format_point(points[0])}" + (
        "l" + " ".join(_format_point(step) for step in steps) if len(steps) else "h0"
    )


def _format_point(point: Iterable[int]) -> str:
    x, y = point
    return f"{x}{y}" if y < 0 else f"{x} {y}"


def join_markup(values: Iterable[SvgValue], separator: str = "") -> Markup:
    """Return the values as markup, one after another."""
    return Markup(separator).join("" if value is None else escape(value) for value in values)


def tag(name: str, /, *content: SvgValue, **attributes: SvgValue) -> Markup:
    """Return an element. `class_` stands for class, `aria_label` for aria-label; None omits an attribute."""
    rendered = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Markup(f"<{name}{rendered}>{join_markup(content)}</{name}>")


def render_path(d: str, **attributes: SvgValue) -> Markup:
    """Return a path whose stroke has the same width at every zoom level."""
    return tag("path", d=d, **attributes, vector_effect="non-scaling-stroke")


def render_use(of: str, class_: str) -> Markup:
    """Return a reference to a shape defined elsewhere on the page, in another style."""
    return tag("use", href=f"#{of}", class_=class_)


def render_picture(label: str, box: str, *content: SvgValue, class_: str) -> Markup:
    """Return an SVG that screen readers announce as one image."""
    return tag("svg", tag("title", label), *content, viewBox=box, class_=class_, role="img", aria_label=label)


def render_scale_bar(svg: SvgFrame, view: MapView, words: float = 0.017) -> Markup:
    """Return a bar of round length at the lower right; `words` is its font size as a share of the picture."""
    width, height = view.size
    length = next((m for m in (100.0, 50.0, 20.0, 10.0, 5.0) if m <= width / 5), 2.0)
    right, low = view.right - 0.025 * width, view.low + 0.03 * height
    bar = np.array([[right - length, low], [right, low]])
    x, y = svg.to_cm(bar.mean(0)[None])[0]
    size = words * max(width, height) * CM
    word = tag("text", f"{length:.0f} m", x=f"{x}", y=f"{y - 0.5 * size:.0f}", font_size=f"{size:.0f}", class_="scale")
    return tag("g", render_path(svg.line_path(bar), class_="bar"), word, aria_hidden="true")
