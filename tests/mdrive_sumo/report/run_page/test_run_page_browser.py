"""The page of a run in a browser: filters, keyboard, deep links, a phone."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, open_quietly
from testing.view_runs import make_run

from mdrive_sumo.report.run_page.run_page import render_run_page
from mdrive_sumo.report.run_page.run_page_data import build_run_page_data
from mdrive_sumo.runs.stored_run import load_stored_run

pytestmark = pytest.mark.slow
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
SHOWN = "[...document.querySelectorAll('.scenario:not([hidden]) h3')].map((node) => node.textContent)"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("story")
    path = folder / "index.html"
    stored = load_stored_run(make_run(folder, "--seeds", "2"))
    path.write_text(render_run_page(build_run_page_data(stored, {("s0", 1)}, path)), encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, page_file: Path) -> Iterator[Any]:
    yield from open_quietly(browser, page_file.as_uri())


@needs_browser
def test_filters_show_what_fits_and_stay_in_the_address(page: Any, page_file: Path) -> None:
    assert page.evaluate(SHOWN) == ["s0", "s2", "s1"]
    page.select_option("#outcome", "success")
    assert page.evaluate(SHOWN) == ["s1"]
    page.click("#clear")
    page.select_option("#kind", "collision-vehicle")
    assert page.evaluate(SHOWN) == ["s0"]
    assert page.url.endswith("#kind=collision-vehicle")
    page.goto(f"{page_file.as_uri()}#crashed=1")
    assert page.evaluate(SHOWN) == ["s2"] and page.is_checked("#crashed")
    assert page.inner_text("#count") == "1 of 3 scenarios, 2 of 6 episodes"
    page.goto(f"{page_file.as_uri()}#bucket=Tiny&category=deed&kind=nonsense")
    assert len(page.evaluate(SHOWN)) == 3


@needs_browser
def test_the_keyboard_searches_and_reaches_every_link(page: Any) -> None:
    page.keyboard.press("/")
    page.keyboard.type("HIT vehicle")
    assert page.evaluate(SHOWN) == ["s0"]
    page.keyboard.press("Control+A")
    page.keyboard.type("nothing like it")
    assert page.evaluate(SHOWN) == [] and page.is_visible("#nothing")
    page.keyboard.press("Control+A")
    page.keyboard.press("Delete")
    reached = set[str]()
    for _ in range(20):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.getAttribute('href') ?? document.activeElement.id"))
    assert {"clear", "s0-seed1.html", "s0-seed1.html#t=1.50"} <= reached


@needs_browser
def test_the_overview_leads_to_a_scenario_that_filters_hide(page: Any) -> None:
    squares = page.locator(".overview a")
    assert [squares.nth(i).get_attribute("href") for i in range(3)] == ["#s-s0", "#s-s2", "#s-s1"]
    page.select_option("#outcome", "success")
    assert page.locator(".overview li.faded").count() == 2
    squares.first.click()
    page.wait_for_timeout(50)
    assert len(page.evaluate(SHOWN)) == 3 and page.input_value("#outcome") == ""
    assert page.url.endswith("#s-s0")


@needs_browser
def test_failures_have_a_button(page: Any) -> None:
    page.click("#show-failures")
    assert page.evaluate(SHOWN) == ["s2"]
    page.click("#s-s2 .why summary >> nth=0")
    assert "Traceback" in page.inner_text("#s-s2 pre >> nth=0")


@needs_browser
@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_the_page_fits_its_window(page: Any, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
