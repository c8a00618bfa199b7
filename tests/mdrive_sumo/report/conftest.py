"""Shared by the tests of pages: the browser."""

from collections.abc import Iterator
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_flags, list_gl_flags


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Ends with its module: while playwright runs, no test can run an event loop of its own."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=list_flags())
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def gl_browser() -> Iterator[Any]:
    """A browser with WebGL, drawn by SwiftShader."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=list_gl_flags())
        yield chromium
        chromium.close()
