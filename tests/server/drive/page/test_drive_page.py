"""The drive page in Chromium, with a played server: keys, pictures, messages, and what is lost."""

from typing import Any

import pytest
from testing.chromium import CHROMIUM, wait_until
from testing.drive_page_server import DrivePageServer

from server.drive.page_files import PAGE, read_page_files
from server.drive.protocol import Device
from tests.server.drive.page.conftest import Opened

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


def started(server: DrivePageServer) -> Any:
    """Press Start and wait until the car drives; the tab."""
    server.page.keyboard.press("Enter")  # the button has the focus
    wait_until(server.page, "document.body.dataset.mode === 'driving'")
    return server.page


def test_keys_drive_the_car(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle == 1.0 and server.own.vx > 1.0)
    assert {given.device for given in server.received} == {Device.KEYBOARD}
    page.keyboard.up("w")
    page.keyboard.down("ArrowLeft")
    server.drive_until(lambda: server.control.steer > 0.3 and server.control.throttle == 0.0)
    page.keyboard.up("ArrowLeft")
    server.drive_until(lambda: server.control.steer == 0.0)
    page.keyboard.press("Space")
    assert [given.number for given in server.received] == list(range(1, len(server.received) + 1))
    shown = page.evaluate("Drive.prediction.head.x")
    assert shown == pytest.approx(server.own.x, abs=2.0)
    assert page.text_content("#speed") == str(round(server.own.vx * 3.6))


def test_all_scripts_of_the_view_are_on_the_page() -> None:
    files = read_page_files()
    page = files[PAGE].decode()
    assert [name for name in files if name.endswith(".js") and f"/static/{name}" not in page] == []
    assert [name for name in files if name.endswith(".css") and f"/static/{name}" not in page] == []
    assert sum(map(len, files.values())) < 2_000_000
