"""The documentation site: its Python reference is complete, its search works from a folder."""

import re
import shutil
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_type_hints

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from playwright.sync_api import sync_playwright
from testing.chromium import CHROMIUM, list_flags, open_quietly
from testing.paths import ROOT

import mdrive_sumo as md
from mdrive_sumo import contract

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


PAGES = ("python.md", "install.md", "decisions/007-click-for-the-command-line.md")
"""Of the site that is built here; the gate builds all of it (`make docs`)."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few pages of the site, without their links to other pages."""
    folder = tmp_path_factory.mktemp("site")
    for name in PAGES:
        (folder / "docs" / name).parent.mkdir(parents=True, exist_ok=True)
        text = (ROOT / "docs" / name).read_text("utf-8")
        (folder / "docs" / name).write_text(re.sub(r"\]\([^)]*\)", "]", text), "utf-8")
    for name in ("javascripts", "stylesheets"):
        shutil.copytree(ROOT / "docs" / name, folder / "docs" / name)
    config = load_config(
        str(ROOT / "mkdocs.yml"), docs_dir=str(folder / "docs"), site_dir=str(folder / "site"), nav=list(PAGES)
    )
    build(config)
    return folder / "site"


@pytest.fixture(scope="module")
def page(site: Path) -> str:
    return (site / "python.html").read_text("utf-8")


def list_exchanged_types() -> list[type]:
    """Every dataclass that an agent is given or gives, and those of their fields."""
    found: list[type] = []
    queue: list[object] = [contract.SensorSpec, contract.Briefing, contract.Observation, contract.Reply]
    while queue:
        kind = queue.pop()
        queue += getattr(kind, "__args__", ())
        if isinstance(kind, type) and is_dataclass(kind) and kind not in found:
            found.append(kind)
            queue += get_type_hints(kind).values()
    return found


def test_every_name_of_the_front_door_has_an_entry(page: str) -> None:
    entries = {path.rpartition(".")[2] for path in re.findall(r'id="(mdrive_sumo\.[\w.]+)"', page)}
    assert set(md.__all__) - entries == set()


@pytest.mark.parametrize("kind", list_exchanged_types(), ids=lambda kind: kind.__name__)
def test_every_exchanged_field_is_described(page: str, kind: type) -> None:
    base = f"mdrive_sumo.contract.{kind.__name__}"
    for field in fields(kind):
        found = re.search(
            rf'id="{re.escape(f"{base}.{field.name}")}".*?<div class="doc doc-contents ">(.*?)</div>', page, re.S
        )
        assert found, f"{base}.{field.name}: no entry"
        assert re.sub(r"<[^>]+>", "", found[1]).strip(), f"{base}.{field.name}: no text"


def test_constructors_have_signatures(page: str) -> None:
    for name in ("Plan", "Control", "Reply", "SensorSpec", "Message", "OwnState"):
        after = page.partition(f'id="mdrive_sumo.contract.{name}"')[2]
        signature = re.sub(r"<[^>]+>", "", after.partition("</pre>")[0])
        for field in fields(getattr(contract, name)):
            assert re.search(rf"\b{field.name}\b", signature), (name, field.name, signature[:300])


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_search_works_from_a_folder_and_finds_what_users_ask_first(site: Path) -> None:
    """Decision records mention everything: they come last."""
    with sync_playwright() as started, started.chromium.launch(executable_path=CHROMIUM, args=list_flags()) as browser:
        for tab in open_quietly(browser, (site / "python.html").as_uri()):
            tab.locator(".md-search__input").click()
            tab.keyboard.type("packages")
            tab.locator(".md-search-result__item h1").first.wait_for()
            found = [title.inner_text() for title in tab.locator(".md-search-result__item h1").all()]
            assert found[-1].startswith("007 ") and len(found) > 1, found
