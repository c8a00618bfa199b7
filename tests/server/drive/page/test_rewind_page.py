"""The panel of takes and time in Chromium, with a played server."""

from collections.abc import Mapping
from typing import Any

import pytest
from testing.chromium import CHROMIUM, wait_until
from testing.drive_page_server import DrivePageServer

from server.drive.protocol import FrameState
from tests.server.drive.page.conftest import Opened
from tests.server.drive.page.test_drive_page import paused, started

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
SEEK = """([tick]) => { $("time").value = tick; $("time").dispatchEvent(new Event("input")); }"""


def end_take(server: DrivePageServer, rest: int, **changes: Any) -> Mapping[str, Any]:
    """End the take now, as its person asks; it is finished in the background, for so many ticks."""
    server.state = FrameState.FINISHED
    server.send_frame()
    left = server.tick_number
    server.states += [server.own] * rest
    take = server.takes[server.take - 1]
    take |= {"status": "finished", "left_tick": left, "end_tick": left + rest, "score": 40.0, **changes}
    return take


def test_the_rest_of_a_take_that_was_ended_early_can_be_looked_at(opened: Opened) -> None:
    """It is computed in the background, after the page has loaded what was driven."""
    server = opened()
    page = started(server)
    server.drive(12)
    paused(server)
    wait_until(page, "Drive.rewind.motions.get(1)")
    left = server.tick_number
    end_take(server, 30)
    wait_until(page, "document.body.dataset.mode === 'finished'")
    assert page.evaluate("[Drive.rewind.lastTick, Drive.rewind.isScrubbing]") == [left, False]
    server.send_tree()
    wait_until(page, f"$('time').max === '{left + 30}'")
    wait_until(page, f"Drive.rewind.motions.get(1).ticks === {left + 31}")
    page.evaluate(SEEK, [left + 25])
    assert page.evaluate("[Drive.rewind.isScrubbing, Drive.rewind.motion !== undefined]") == [True, True]
    assert page.get_attribute("body", "data-shown-tick") == str(left + 25)
    page.click("#do-resume")
    assert page.evaluate("[Drive.rewind.isScrubbing, Drive.rewind.tick]") == [False, left]


def test_what_was_refused_can_be_asked_for_again(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(3)
    paused(server)
    send = server.send
    refusal = {"is": "problem", "text": "what-if: expected one at a time, found another under way"}
    server.send = lambda message: send(refusal if message["is"] == "ghosts" else message)
    page.keyboard.press("g")
    wait_until(page, f"$('notice').textContent === {refusal['text']!r}")
    assert page.is_enabled("#do-what-if")
    server.send = send
    page.keyboard.press("g")
    wait_until(page, "document.querySelectorAll('#ghosts li').length === 2")


def test_nobody_drives_on_after_the_person_has_left(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(12)
    paused(server)
    left = server.tick_number
    end_take(server, 30)
    server.send_tree()
    wait_until(page, f"$('time').max === '{left + 30}'")
    page.evaluate(SEEK, [left + 5])
    assert not page.is_enabled("#do-branch")
    assert f"nobody drove after 0:{left / 20:04.1f}" in page.inner_text("#shown-take")
    page.evaluate(SEEK, [left])
    assert page.is_visible("#do-branch") and page.is_enabled("#do-branch")
    page.evaluate("Drive.card.hide()")
    page.click("#do-branch")
    wait_until(page, "document.body.dataset.take === '2'")
    assert server.asked[-1] == {"do": "rewind", "take": 1, "tick": left}
