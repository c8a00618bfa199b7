"""Self-contained HTML pages: templates of `report/static` with the style and the script inlined."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.core.tables import Cell, Column, format_cell, format_cell_interval

PAGE_TEMPLATES = Environment(
    loader=PackageLoader("mdrive_sumo.report", "static"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=clean_for_page,
    trim_blocks=True,
    lstrip_blocks=True,
)


def _format_value(cell: Cell, column: Column) -> str:
    """Return a cell's text without its interval, which a page shows smaller."""
    return format_cell(replace(cell, interval=None), column)


_TABLE_FUNCTIONS: dict[str, Any] = {
    "format_cell": format_cell,
    "format_value": _format_value,
    "format_cell_interval": format_cell_interval,
}
"""What `table.html` shows tables of `core.tables` with."""
PAGE_TEMPLATES.globals.update(_TABLE_FUNCTIONS)


def render_html_page(
    template: str,
    *,
    title: str,
    style: str,
    script: str = "",
    frame_styles: Sequence[str] = (),
    frame_scripts: Sequence[str] = (),
    late_scripts: Sequence[str] = (),
    **values: Any,
) -> str:
    """Return a page that extends `page.html`, or `page.html` itself with `body`.

    Its content policy forbids every connection, and every style and script but its own, those of pages in its frames,
    and those that its own script starts later (`late_scripts`).
    """
    return PAGE_TEMPLATES.get_template(template).render(
        title=title,
        style=style,
        script=script,
        style_hashes=[_hash_for_policy(text) for text in (style, *frame_styles)],
        script_hashes=[_hash_for_policy(text) for text in (script, *frame_scripts, *late_scripts) if text],
        **values,
    )


def read_static(name: str) -> str:
    """Return the text of a file of `report/static`."""
    return (files("mdrive_sumo.report") / "static" / name).read_text("utf-8")


def _hash_for_policy(text: str) -> str:
    """Return the name of an inline script or style in a Content-Security-Policy (CSP level 3, section 2.3.1)."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
