"""What V2X tells on the drive page, in Chromium with a played server: objects, intentions, words and warnings."""

from typing import Any

import pytest
from testing.chromium import CHROMIUM, wait_until

from tests.server.drive.page.conftest import Opened
from tests.server.drive.page.test_drive_page import MESSAGES, paused, started

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
COUNT_SIGNS = """() => {
  const [map, copy] = [$("map"), document.createElement("canvas")];
  [copy.width, copy.height] = [map.width, map.height];
  const ctx = copy.getContext("2d", {willReadFrequently: true});
  ctx.fillStyle = Drive.picture.top.theme.bad;
  ctx.fillRect(0, 0, 1, 1);
  const [r, g, b] = ctx.getImageData(0, 0, 1, 1).data;
  ctx.drawImage(map, 0, 0);
  const {data} = ctx.getImageData(0, 0, copy.width, copy.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) count += data[i] === r && data[i + 1] === g && data[i + 2] === b;
  return count;
}"""
"""Pixels of the picture in the colour of the sign of a danger."""
AHEAD = "(({x, y, yaw}) => [x + 30 * Math.cos(yaw), y + 30 * Math.sin(yaw)])(Drive.describe(true).centre)"


def test_v2x_and_words(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.extra = {"messages": MESSAGES}
    server.drive(2)
    overlays = "Drive.describe(true).overlays"
    assert page.evaluate(f"{overlays}.shared[0].x") == pytest.approx(-30, abs=1)
    assert page.evaluate(f"{overlays}.intentions[0].path") == [[60, 21], [0, 21]]
    assert page.evaluate(f"{overlays}.words[0].text") == "You go first."
    assert page.get_attribute("#do-chat", "data-unread") == "1"
    page.keyboard.press("v")
    assert page.evaluate(f"{overlays}.shared") is None
    page.keyboard.press("t")
    page.keyboard.type("wide as a bus")  # letters that are commands and pedals elsewhere
    page.keyboard.press("Enter")
    wait_until(page, "document.querySelectorAll('#words li').length === 2")
    assert server.asked[-1] == {"do": "say", "text": "wide as a bus"}
    assert page.evaluate("Drive.inputs.keyboard.held.size") == 0
    page.keyboard.press("Escape")
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle > 0)


def test_a_warning_has_a_sign_and_its_cause_until_it_is_over(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.press("4")
    before, event = page.evaluate(COUNT_SIGNS), page.evaluate(AHEAD)
    warning: dict[str, Any] = {"from": "bbbb1111", "to": ["ego_0"], "kind": "denm", "cause": "collision risk"}
    warning |= {"event": event, "valid_ticks": 20, "ended": False}
    server.extra = {"messages": [warning]}
    server.drive(2)
    assert page.evaluate("Drive.describe(true).overlays.warnings.map(({x, y}) => [x, y])") == [event]
    assert (page.text_content("#heard .warning") or "").endswith("⚠ collision risk")
    assert page.evaluate(COUNT_SIGNS) > before + 50
    server.extra = {"messages": [{**warning, "ended": True}]}
    server.drive(2)
    assert not page.is_visible("#heard") and page.evaluate(COUNT_SIGNS) == before
    server.extra = {"messages": [warning]}
    server.drive(2)
    assert page.is_visible("#heard")
    server.drive_until(lambda: not page.is_visible("#heard"), ticks=22)


def test_a_condition_without_v2x_and_chat(opened: Opened) -> None:
    server = opened(v2x_view=False, chat=False, may_rewind=False)
    page = started(server)
    server.extra = {"messages": MESSAGES[:2]}
    server.drive(2)
    assert page.evaluate("Drive.describe(true).overlays.shared") is None
    assert not page.is_visible("#do-v2x") and not page.is_visible("#do-chat")
    page.keyboard.press("t")
    assert not page.is_visible("#talk")
    paused(server)
    assert not page.is_visible("#rewind") and page.is_visible("#card")
