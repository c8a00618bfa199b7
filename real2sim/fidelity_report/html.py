"""HTML of the report: text is escaped wherever it enters an element, so text of a log cannot break a page."""

from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from mdrive_sumo.core.clean_text import clean_for_page
from mdrive_sumo.report.html_page import render_html_page

MarkupValue = str | int | float | None
"""Content of an element or value of an attribute: `Markup` is kept, other text is escaped, None is omitted."""
_TEMPLATES = Environment(
    loader=PackageLoader("real2sim.fidelity_report"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=clean_for_page,
)
VOID_ELEMENTS = frozenset(("input",))


def join_markup(values: Iterable[MarkupValue], separator: str = "") -> Markup:
    """Return the values as markup, one after another."""
    return Markup(separator).join("" if value is None else escape(value) for value in values)


def tag(name: str, /, *content: MarkupValue, **attributes: MarkupValue) -> Markup:
    """Return an element. `class_` stands for class, `aria_label` for aria-label; None omits an attribute."""
    rendered = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    end = "" if name in VOID_ELEMENTS else f"{join_markup(content)}</{name}>"
    return Markup(f"<{name}{rendered}>{end}")


def render_table(
    head: Sequence[MarkupValue], rows: Iterable[Iterable[MarkupValue]], label: str, text_columns: int = 1
) -> Markup:
    """Return a table that scrolls where it is too wide or too long; columns after `text_columns` are right-aligned."""
    template = _TEMPLATES.get_template("table.html")
    return Markup(template.render(head=head, rows=rows, label=label, text_columns=text_columns))


def render_page(title: str, *content: MarkupValue) -> str:
    """Return a whole page. Its content security policy forbids scripts and requests; the style sheet is inlined."""
    style = (files("real2sim.fidelity_report") / "static" / "report.css").read_text("utf-8")
    return render_html_page("page.html", title=title, style=style, body=join_markup(content)) + "\n"


def link_entry(id_: str, number_by_id: Mapping[str, int]) -> Markup:
    """Return a link to the entry of an actor by its number, or the actor's id if it has no entry."""
    number = number_by_id.get(id_)
    return tag("a", f"No. {number}", href=f"#actor-{number}") if number else tag("code", id_, class_="id")


def render_list(items: Iterable[MarkupValue], class_: str | None = None) -> Markup:
    """Return a bullet list."""
    return tag("ul", *(tag("li", item) for item in items), class_=class_)


def render_collapsible_list(title: str, items: Sequence[str]) -> Markup:
    """Return a list that opens with a click, or a sentence that says it is empty."""
    if not items:
        return tag("p", f"{title}: none.", class_="none")
    return tag("details", tag("summary", f"{title}: {len(items)}"), render_list(items, "columns"))
