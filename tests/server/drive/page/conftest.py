"""Shared by the tests of the drive page: the browser, and a page that a played server serves."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_flags, wait_until
from testing.drive_page_server import ADDRESS, DrivePageServer

CONTEXT_LOST = "THREE.WebGLRenderer: Context Lost."
"""What three.js says where a test takes WebGL away."""
Opened = Callable[..., DrivePageServer]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without WebGL, which is quick: the top view."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=[*list_flags(), "--disable-3d-apis"])
        yield chromium
        chromium.close()


@contextmanager
def open_pages(browser: Any) -> Iterator[Opened]:
    """Open the page at a played server: `opened(size=(390, 844), ...)`. Nothing may complain.

    script: of JavaScript, run before those of the page. Other options are those of `DrivePageServer`.
    """
    contexts, trouble = [], []

    def open_page(
        size: tuple[int, int] = (1280, 720), touch: bool = False, script: str = "", **options: Any
    ) -> DrivePageServer:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, has_touch=touch)
        contexts.append(context)
        page = context.new_page()
        if script:
            page.add_init_script(script)
        page.on("console", lambda message: trouble.append(message.text))
        page.on("pageerror", lambda error: trouble.append(str(error)))
        server = DrivePageServer(page, **options)
        page.goto(ADDRESS)
        wait_until(page, "document.body.dataset.scene")
        return server

    yield open_page
    for context in contexts:
        context.close()
    assert [text for text in trouble if text != CONTEXT_LOST] == []


@pytest.fixture
def opened(browser: Any) -> Iterator[Opened]:
    """See `open_pages`."""
    with open_pages(browser) as open_page:
        yield open_page
