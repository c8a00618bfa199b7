"""The pages of the docs: links and citations lead somewhere, the site shows all of them, none is too long."""

import re
from pathlib import Path

import pytest
from testing.paths import ROOT

PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")})


def list_anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives the headings of a page; mkdocs.yml makes the site's by the same rule."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#{1,6} (.+)$", text, re.MULTILINE)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_work_on_the_site_and_in_the_repository(page: Path) -> None:
    is_of_site = page.is_relative_to(ROOT / "docs")
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
        name, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{link}: no such file"
        assert not is_of_site or target.is_relative_to(ROOT / "docs"), f"{link}: leaves the site"
        assert not anchor or anchor in list_anchors(target), f"{link}: no such heading"


MOST_WORDS = 2200
"""Of a page of one subject: about ten minutes of reading."""
LONG_PAGES = {
    "agents.md": "not divided yet",
    "api.md": "one reference of all paths",
    "findings.md": "one argument with its evidence",
    "gallery.md": "generated",
    "place-kinds.md": "generated",
    "glossary.md": "a list of terms",
    "hard.md": "not divided yet",
    "protocol.md": "the sections of the protocol, in its order",
    "real2sim.md": "not divided yet",
    "results/detectors.md": "tables written from values",
    "results/detectors-crowds.md": "tables written from values",
    "results/open-closed.md": "tables written from values, and two paragraphs",
    "results/paper.md": "generated",
    "scoring.md": "not divided yet",
    "studies.md": "not divided yet",
    "training.md": "not divided yet",
    "v2x.md": "not divided yet",
}
"""Pages that may be longer, with the reason."""


def test_pages_are_short() -> None:
    words_by_page = {
        str(page.relative_to(ROOT / "docs")): len(page.read_text("utf-8").split())
        for page in PAGES
        if page.is_relative_to(ROOT / "docs") and page.parent.name not in ("decisions", "how-to")
    }
    long_pages = {name: words for name, words in words_by_page.items() if words > MOST_WORDS}
    assert {name: words for name, words in long_pages.items() if name not in LONG_PAGES} == {}
    assert LONG_PAGES.keys() <= words_by_page.keys()


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8").partition("\nnav:\n")[2]
    listed = re.findall(r": ([\w/-]+\.(?:md|ipynb))$", navigation, re.MULTILINE)
    pages = {str(page.relative_to(ROOT / "docs")) for page in PAGES if page.is_relative_to(ROOT / "docs")}
    records = {name for name in pages if re.match(r"decisions/\d", name)}
    tutorials = {str(path.relative_to(ROOT / "docs")) for path in ROOT.glob("docs/tutorials/*.ipynb")}
    assert sorted(listed) == sorted(pages - records | tutorials)


def test_warnings_fail_the_build_of_the_site() -> None:
    """With --quiet MkDocs does not count warnings, so `strict` would have no effect."""
    recipe = (ROOT / "Makefile").read_text().partition("\ndocs: ")[2].partition("\n\n")[0]
    assert "mkdocs build" in recipe
    assert "--quiet" not in recipe and "-q" not in recipe
    assert "\nstrict: true\n" in (ROOT / "mkdocs.yml").read_text()


def list_citing_files() -> list[Path]:
    """The files of code and settings, which name pages in docstrings, messages and comments."""
    folders = ("mdrive_sumo", "real2sim", "server", "tools", "tests", "docker")
    kinds = ("*.py", "*.toml", "*.yaml", "*.sh", "*.html", "*.js", "*.service")
    return [path for folder in folders for kind in kinds for path in (ROOT / folder).rglob(kind)]


def test_pages_that_code_names_exist() -> None:
    """So do headings that follow the name, in quotes or within the brackets of the name."""
    cited = {
        (found[1], found[2] or found[3] or "")
        for path in list_citing_files()
        for found in re.finditer(
            r"""docs/([\w/-]+\.md)(?:, "([^"\n]+)"|,["\s]+(?:f")?([A-Z][^)"\n]*)\))?""", path.read_text("utf-8")
        )
    }
    pages = {(name, heading) for name, heading in cited if name != "models/NAME.md"}
    assert len(pages) > 20 and any(heading for _, heading in pages)
    for name, heading in pages:
        page = ROOT / "docs" / name
        assert page.exists(), f"docs/{name}"
        anchor = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        assert not heading or anchor in list_anchors(page), f"docs/{name}, {heading}"
