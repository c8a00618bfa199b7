"""HTML of the report: templates escape the text of a log wherever it enters an element, so it cannot break a page."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.report.html_page import render_html_page
from real2sim.fidelity_report.formatting import format_figure, format_frames, format_share

TEMPLATES = Environment(
    loader=PackageLoader("real2sim.fidelity_report"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=clean_for_page,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.filters |= {"figure": format_figure, "share": format_share, "frames": format_frames}
PAGE = "conversion.html"
"""File of the index in the folder of a suite, and of a scenario's report in that of the scenario."""


def render_page(template: str, title: str, **values: Any) -> str:
    """Return a whole page. Its content security policy forbids scripts and requests; the style sheet is inlined."""
    body = Markup(TEMPLATES.get_template(template).render(title=title, page=PAGE, **values))
    style = (files("real2sim.fidelity_report") / "static" / "report.css").read_text("utf-8")
    return render_html_page("page.html", title=title, style=style, body=body) + "\n"
