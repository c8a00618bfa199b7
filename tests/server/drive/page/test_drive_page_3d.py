"""The drive page with WebGL, drawn by the processor: all views, overlays, ghosts, and a driver that gives up."""

from collections.abc import Iterator
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_gl_flags, wait_until

from tests.server.drive.page.conftest import Opened, open_pages
from tests.server.drive.page.test_drive_page import MESSAGES, paused, started

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
SMALL = (480, 270)
"""Few pixels, because the processor draws them."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium with WebGL."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as run:
        chromium = run.chromium.launch(executable_path=CHROMIUM, args=list_gl_flags())
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Opened]:
    """See `open_pages`."""
    with open_pages(browser) as open_page:
        yield open_page


def count_colours(page: Any) -> int:
    """Different colours in the picture."""
    return page.evaluate("""() => {
      Drive.picture.view3d.draw();
      const copy = document.createElement("canvas");
      [copy.width, copy.height] = [160, 90];
      const ctx = copy.getContext("2d");
      ctx.drawImage($("scene"), 0, 0, 160, 90);
      const {data} = ctx.getImageData(0, 0, 160, 90);
      const seen = new Set();
      for (let i = 0; i < data.length; i += 4) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
      return seen.size;
    }""")


@pytest.mark.full
def test_all_views_draw_all_there_is(opened: Opened) -> None:
    server = opened(size=SMALL)
    page = started(server)
    assert page.get_attribute("body", "data-scene") == "3d"
    server.extra = {"messages": MESSAGES}
    page.keyboard.down("w")
    for view in ("1", "2", "3", "4", "1"):
        page.keyboard.press(view)
        drawn = page.evaluate("Drive.frameTimes.length")
        server.drive_until(lambda drawn=drawn: page.evaluate("Drive.frameTimes.length") > drawn + 2)
        if view != "4":
            assert count_colours(page) > 200
    assert page.evaluate("Drive.keyTimes.length") == 1
    page.keyboard.up("w")
    paused(server)
    page.keyboard.press("g")
    wait_until(page, "Drive.rewind.ghosts.length === 2 && Drive.rewind.ghostsAt(Drive.tick).length === 2")
    page.wait_for_timeout(200)


def test_a_graphics_driver_that_gives_up(opened: Opened) -> None:
    page = started(opened(size=SMALL))
    page.evaluate("""Drive.picture.view3d.renderer.getContext().getExtension("WEBGL_lose_context").loseContext()""")
    wait_until(page, "Drive.picture.view === 'top'")
    assert "The top view drives as well." in (page.text_content("#notice") or "")
