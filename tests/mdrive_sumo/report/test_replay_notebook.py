"""The replay page as a notebook shows it."""

from pathlib import Path
from typing import Any

import pytest
from testing.chromium import wait_until
from testing.viewer_crossing import crossing, record, scenario

from mdrive_sumo.report.replay_page import ReplayPage, render_replay
from tests.mdrive_sumo.report.test_replay_page import needs_browser


@pytest.mark.slow
@needs_browser
def test_the_replay_works_inside_a_notebook(browser: Any, tmp_path: Path) -> None:
    """A notebook shows the page in a frame without an address or an origin of its own."""
    path = tmp_path / "notebook.html"
    page = ReplayPage(render_replay(record(), scenario(2), crossing(), ()))
    path.write_text("<!doctype html><body>" + page._repr_html_(), encoding="utf-8")
    tab = browser.new_page()
    trouble: list[str] = []
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    tab.goto(path.as_uri())
    frame = tab.frames[1]
    wait_until(frame, "window.viewer && viewer.drawTimes.length > 0")
    frame.evaluate("viewer.seek(20)")
    frame.wait_for_timeout(400)  # the address of a page of its own is updated after 250 ms
    assert frame.evaluate("viewer.tick") == 20 and trouble == []
    tab.close()
