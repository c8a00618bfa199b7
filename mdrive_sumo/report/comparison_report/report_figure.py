"""ReportFigure: a figure as a value, drawn when it is written."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from mdrive_sumo.report.figure_style import open_figure, render_figure

INK, PAPER, GRID = "#000000", "#ffffff", "#dddddd"
"""Colours of lines and text, background and grid in figures, which a page replaces by its own."""


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A figure of a report. `name` is the stem of its files."""

    name: str
    title: str
    description: str
    """What it shows, for readers who cannot see it."""
    size_in: tuple[float, float]
    draw: Callable[[Figure], None]

    def render(self) -> tuple[bytes, bytes]:
        """Return the figure as PNG and as SVG, the same bytes for the same numbers."""
        with open_figure(*self.size_in) as figure:
            self.draw(figure)
            return render_figure(figure, "png"), render_figure(figure, "svg")


def inline_svg(svg: bytes, name: str) -> str:
    """Return an SVG element for a page: in the page's colours, light and dark, with ids that begin with `name`."""
    text = svg.decode("utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for before in ('id="', 'href="#', "url(#"):
        text = text.replace(before, f"{before}{name}-")
    for colour, variable in ((INK, "ink"), (PAPER, "card"), (GRID, "grid")):
        text = text.replace(f": {colour}", f": var(--{variable})")
    return text.strip()
