"""Markup that cannot be broken by text of a log: whatever is not `Html` already is escaped when it goes into a tag."""

import base64
import hashlib
import html
from collections.abc import Iterable
from importlib.resources import files


class Html(str):
    """Finished markup; only this module and tags make it."""

    __slots__ = ()


Piece = str | int | float | None
"""Content of a tag or value of an attribute; None is left out."""
VOID = frozenset(("meta", "link", "input", "br"))


def escaped(value: Piece) -> Html:
    """Text as markup; markup as it is."""
    if isinstance(value, Html):
        return value
    return Html("" if value is None else html.escape(str(value)))


def joined(pieces: Iterable[Piece], between: str = "") -> Html:
    """Pieces one after another."""
    return Html(escaped(between).join(map(escaped, pieces)))


def tag(name: str, /, *content: Piece, **attributes: Piece) -> Html:
    """An element. `class_` is class, `aria_label` is aria-label; an attribute that is None is left out."""
    told = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escaped(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{told}>" if name in VOID else f"<{name}{told}>{joined(content)}</{name}>")


def table(head: Iterable[Piece], rows: Iterable[Iterable[Piece]], label: str, words: int = 1) -> Html:
    """A table that scrolls where it is too wide or too long; columns from `words` on are flush right."""
    head = tuple(head)

    def cells(row: Iterable[Piece]) -> Html:
        return joined(_cell(cell, k, words) for k, cell in enumerate(row))

    heading = tag("tr", *(tag("th", cell, scope="col", class_=_side(k, words)) for k, cell in enumerate(head)))
    body = joined((tag("tr", cells(row)) for row in rows), "\n")
    whole = tag("table", tag("thead", heading), "\n", tag("tbody", body))
    return tag("div", whole, class_="wide tall", role="region", aria_label=label, tabindex="0")


def _cell(cell: Piece, column: int, words: int) -> Html:
    return tag("td", cell, class_=_side(column, words))


def _side(column: int, words: int) -> str | None:
    return None if column < words else "number"


def page(title: str, *content: Piece) -> str:
    """A whole page that may load nothing and run nothing; its style travels with it."""
    style = (files("real2sim.fidelity_report") / "static" / "report.css").read_text("utf-8")
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    policy = f"default-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; form-action 'none'"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("link", rel="icon", href="data:,"),
        tag("title", title),
        tag("style", Html(style)),
    )
    return f"<!doctype html>\n{tag('html', head, tag('body', *content), lang='en')}\n"
