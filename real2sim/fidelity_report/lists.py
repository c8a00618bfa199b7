"""Lists of the report, and names of things in them."""

from collections.abc import Mapping, Sequence

from real2sim.fidelity_report.html import Html, tag


def link(id_: str, numbers: Mapping[str, int]) -> Html:
    """A thing by its number, which leads to its pictures; by its id if it has none."""
    number = numbers.get(id_)
    return tag("a", f"No. {number}", href=f"#thing-{number}") if number else tag("code", id_, class_="id")


def named(title: str, items: Sequence[str]) -> Html:
    """A list to be opened, or the word that it is empty."""
    if not items:
        return tag("p", f"{title}: none.", class_="none")
    content = tag("ul", *(tag("li", item) for item in items), class_="columns")
    return tag("details", tag("summary", f"{title}: {len(items)}"), content)
