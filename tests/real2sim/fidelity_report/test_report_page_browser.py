"""The report page in a browser: nothing is fetched, nothing complains, it fits every screen, its links open cards."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_flags
from testing.report_findings import HOSTILE, small_findings

from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.index_page import build_index_row, write_index
from real2sim.fidelity_report.report_page import write_report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.costly_fixture,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium"),
]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> ConversionFindings:
    return small_findings(tmp_path_factory.mktemp("findings"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=list_flags())
        yield chromium
        chromium.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    """An empty tab; at the end, nothing but the page may have been fetched, and nothing may have complained."""
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    trouble: list[str] = []
    requests: list[str] = []
    opened.on("console", lambda message: trouble.append(message.text))
    opened.on("pageerror", lambda error: trouble.append(str(error)))
    opened.on("dialog", lambda dialog: trouble.append(dialog.message))
    opened.on("request", lambda request: requests.append(request.url.split("#")[0]))
    yield opened
    address = opened.url.split("#")[0]
    opened.close()
    assert trouble == []
    assert requests == [address]


@pytest.fixture
def page(tab: Any, found: ConversionFindings, tmp_path: Path) -> Any:
    tab.goto(write_report(tmp_path, found).as_uri())
    return tab


def test_nothing_is_wider_than_the_screen(page: Any) -> None:
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    for width in (1280, 400):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_index_fits_a_small_screen(tab: Any, found: ConversionFindings, tmp_path: Path) -> None:
    tab.set_viewport_size({"width": 400, "height": 800})
    tab.goto(write_index(tmp_path, f"suite {HOSTILE}", [build_index_row(found)]).as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= 400


def test_a_link_opens_the_card_it_leads_to(page: Any) -> None:
    closed = "!document.getElementById('actor-5').closest('details.card').open"
    assert page.evaluate(closed)
    page.click('table a[href="#actor-5"]')
    page.locator("#actor-5").wait_for(state="visible")  # the group of what stands opened for it


def test_layers_can_be_switched_off(page: Any) -> None:
    for layer in ("raw", "way", "rest", "names"):
        shown = f"getComputedStyle(document.querySelector('.layer-{layer}')).display"
        assert page.evaluate(shown) != "none"
        page.uncheck(f"#show-{layer}")
        assert page.evaluate(shown) == "none"


def test_the_map_can_be_enlarged(page: Any) -> None:
    width = "document.querySelector('.map').getBoundingClientRect().width"
    before = page.evaluate(width)
    page.check("#enlarge")
    assert page.evaluate(width) > 2 * before


def test_shared_drawings_are_seen_in_every_picture(page: Any) -> None:
    """Tracks are drawn once and used again; their styles must reach them there."""
    stroke = "getComputedStyle(document.querySelector('.small .way.fail')).stroke"
    assert page.evaluate(stroke) == "rgb(194, 31, 46)"
    size = page.evaluate("document.querySelector('.small .way.fail').getBoundingClientRect().width")
    assert size > 100
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(stroke) == "rgb(255, 112, 122)"
