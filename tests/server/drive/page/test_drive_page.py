"""The drive page in Chromium, with a played server: keys, pictures, messages, and what is lost."""

import json
from typing import Any

import pytest
from testing.chromium import CHROMIUM, wait_until
from testing.drive_page_files import PAGE, read_page_files
from testing.drive_page_server import DrivePageServer
from testing.paths import TESTS

from mdrive_sumo.report.palette import CAV_COLOURS, format_custom_properties
from server.drive.protocol import FrameState, InputDevice
from tests.server.drive.page.conftest import Opened

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
CONTRAST = (TESTS / "testing" / "web_contrast.js").read_text("utf-8")
OFFERED = {"cpm": {"objects": [[-30, 20, 3.1, 4.5, 1.8, 3.0]]}, "mcm": {"path": [[60, 21], [0, 21]]}}
COVERED = """() => [...document.querySelectorAll("#tools button, #speed, #touch > div")].filter((one) => {
  const {left, top, width, height} = one.getBoundingClientRect();
  const seen = width && document.elementFromPoint(left + width / 2, top + height / 2);
  return width && !(seen && (one === seen || one.contains(seen)));
}).map((one) => one.id)"""
MESSAGES = [
    *(
        {"from": "bbbb1111", "to": ["ego_0"], "kind": kind, "at": [60, 21], **content}
        for kind, content in OFFERED.items()
    ),
    {"from": "bbbb1111", "to": ["ego_0"], "kind": "text", "text": "You go first."},
]


def started(server: DrivePageServer) -> Any:
    """Press Start and wait until the car drives; the tab."""
    server.page.keyboard.press("Enter")  # the button has the focus
    wait_until(server.page, "document.body.dataset.mode === 'driving'")
    return server.page


def paused(server: DrivePageServer) -> Any:
    """Pause by its key."""
    server.page.keyboard.press("p")
    wait_until(server.page, "document.body.dataset.mode === 'paused'")
    return server.page


def test_keys_drive_the_car(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle == 1.0 and server.own.vx > 1.0)
    assert {given.device for given in server.received} == {InputDevice.KEYBOARD}
    page.keyboard.up("w")
    page.keyboard.down("ArrowLeft")
    server.drive_until(lambda: server.control.steer > 0.3 and server.control.throttle == 0.0)
    page.keyboard.up("ArrowLeft")
    server.drive_until(lambda: server.control.steer == 0.0)
    assert server.own.vx > 1.0
    server.drive_until(lambda: float(page.inner_text("#speed")) == pytest.approx(server.own.vx * 3.6, abs=3))
    page.keyboard.down("Space")
    server.drive_until(lambda: server.control.brake == 1.0)
    assert [given.number for given in server.received] == list(range(1, len(server.received) + 1))


def test_time_is_dragged_back_and_driven_anew(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.down("w")
    server.drive_until(lambda: server.tick_number >= 60)
    page.keyboard.up("w")
    paused(server)
    wait_until(page, "Drive.rewind.motions.get(1)")
    shown = page.evaluate("""async () => {
      const begin = performance.now();
      $("time").value = 20;
      $("time").dispatchEvent(new Event("input"));
      await new Promise((wake) => requestAnimationFrame(() => requestAnimationFrame(wake)));
      return [performance.now() - begin, document.body.dataset.shownTick, Drive.rewind.describe().own.x];
    }""")
    assert shown[0] < 100 and shown[1] == "20"
    assert shown[2] == pytest.approx(server.states[20].x - 10.0, abs=0.01)
    page.keyboard.press("g")
    wait_until(page, "document.querySelectorAll('#ghosts li').length === 2")
    page.click("#do-branch")
    wait_until(page, "document.body.dataset.mode === 'ready' && document.body.dataset.take === '2'")
    assert (server.take, server.tick_number) == (2, 20)
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle > 0.5 and server.tick_number > 30)
    assert page.evaluate("Drive.rewind.ghostsAt(Drive.tick).length") == 2
    page.keyboard.up("w")
    paused(server)
    assert page.locator("#tree .take").count() == 2
    page.focus("#tree .take:first-child")
    page.keyboard.press("Enter")
    assert page.evaluate("Drive.rewind.shown") == 1
    assert [request["do"] for request in server.asked] == ["resume", "pause", "what-if", "rewind", "resume", "pause"]


def test_the_tree_tells_who_drove_which_stretch(opened: Opened) -> None:
    handed = [(300, "ego_0", "sharing"), (310, "ego_1", "idm"), (500, "ego_0", "human")]
    changes = [{"tick": tick, "cav": cav, "driver": driver} for tick, cav, driver in handed]
    row = {"parent": None, "tick": 0, "drivers": {"ego_0": "human", "ego_1": "sharing"}, "ds": {}, "folder": ""}
    often = [{**changes[0], "tick": tick, "driver": ("human", "sharing")[tick % 2]} for tick in range(1, 9)]
    ended = {**row, "status": "finished", "end_tick": 900}
    first = {**ended, "number": 1, "left_tick": 600, "score": 50.0, "changes": changes, "ds": {"ego_0": 0}}
    second = {**ended, "number": 2, "left_tick": None, "score": 60.0, "changes": often}
    third = {**row, "number": 3, "status": "running", "end_tick": 0, "left_tick": None, "score": None, "changes": []}
    server = opened(takes=[first, second, third])
    server.take = 3
    page = started(server)
    server.drive(2)
    paused(server)
    words = page.evaluate("[...document.querySelectorAll('#tree text')].map((one) => one.textContent)")
    assert words[0].startswith("take 1 · you → sharing → you")
    assert words[1].startswith("take 2 · you and sharing, 9 stretches")
    assert words[2].startswith("take 3 · you") and "→" not in words[2]
    lines = "[...document.querySelector('#tree .take').querySelectorAll('line')]"
    assert page.evaluate(f"{lines}.map((one) => one.dataset.driver)") == ["human", "sharing", "human", ""]
    told = page.evaluate(f"{lines}.map((one) => one.textContent)")
    assert told == ["you, 0:00.0 to 0:15.0", "sharing, 0:15.0 to 0:25.0", "you, 0:25.0 to 0:30.0", "left at 0:30.0"]
    beyond = "document.querySelector('#tree text').getBBox(), Number($('tree').getAttribute('width'))"
    assert page.evaluate(f"(({{x, width}}, room) => room - x - width)({beyond})") > 0, "the words are not cut off"
    ends = page.evaluate(f"{lines}.map((one) => [one.getAttribute('x1'), one.getAttribute('x2')].map(Number))")
    assert [one[1] for one in ends[:-1]] == [one[0] for one in ends[1:]]


def test_an_agent_drives_and_gives_back(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.press("o")
    server.drive(1)
    assert server.asked[-1] == {"do": "hand-over", "cav": "ego_0", "to": "sharing"}
    server.extra = {"drivers": {"ego_0": "sharing"}}
    server.drive(2)
    assert page.text_content("#device") == "sharing drives"
    count = len(server.received)
    server.drive(3)
    assert len(server.received) == count  # nothing is sent that nobody uses
    page.keyboard.press("o")
    server.drive(1)
    assert server.asked[-1] == {"do": "hand-over", "cav": "ego_0", "to": "human"}
    server.extra = {"drivers": {"ego_0": "human"}}
    server.drive_until(lambda: len(server.received) > count)


def test_a_lost_connection_comes_back(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(3)
    server.socket.close(code=1011, reason="server restarts")
    wait_until(page, "document.body.dataset.mode === 'lost'")
    assert "Trying again for" in (page.text_content("#card") or "")
    wait_until(page, "document.body.dataset.mode === 'ready'")
    assert page.text_content("#card-title") == "Connected again"
    page.keyboard.press("Enter")
    count = len(server.received)
    server.drive_until(lambda: len(server.received) > count + 2)
    assert server.received[count].number == 1  # numbered anew


def test_a_refusal_is_told(opened: Opened) -> None:
    server = opened()
    server.socket.close(code=1008, reason="ego_0 has a driver already.")
    wait_until(server.page, "document.body.dataset.mode === 'closed'")
    assert "ego_0 has a driver already." in (server.page.text_content("#card") or "")


def test_the_end_has_scores_and_commands(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(3)
    server.finish()
    wait_until(page, "document.body.dataset.mode === 'finished'")
    assert page.is_visible("#card")
    card = page.inner_text("#card")
    for text in (
        "75.0\ndriving score of your CAV, of 100",
        "All CAVs: mean 87.5, lowest 75.0 (yours)",
        "mdrive-sumo verify takes/1",
        "Drag the time back",
        "blocked, driving score 100.0",
        "hit a building",
    ):
        assert text in card
    assert page.text_content("#clock") == "arrived"
    assert "score 75.0 (all 87.5)" in page.inner_text("#shown-take")
    assert page.evaluate(CONTRAST)["below"] == []


def test_a_participant_of_a_study_reads_no_commands(opened: Opened) -> None:
    server = opened(may_rewind=False, may_hand_over=False, return_path="/study?token=x")
    page = server.page
    assert "crossing_left" not in page.inner_text("body") and "a bus hides" not in page.inner_text("body")
    started(server)
    assert not page.is_visible("#do-agent")
    page.keyboard.press("o")
    server.drive(3)
    server.finish()
    wait_until(page, "document.body.dataset.mode === 'finished'")
    card = page.inner_text("#card")
    assert "87.5" in card and "mdrive-sumo" not in card and "Back to the study" in card
    wait_until(page, "document.getElementById('do-pause').hidden && document.getElementById('do-agent').hidden")
    assert [request["do"] for request in server.asked] == ["resume"]


def test_where_a_recorded_run_is_entered(opened: Opened) -> None:
    server = opened(takes=[{"number": 1, "parent": None, "tick": 100, "drivers": {}, "status": "running",
                            "end_tick": 100, "score": None, "ds": {}, "folder": "takes/1"}])  # fmt: skip
    assert "0:05.0 of a recorded run" in server.page.inner_text("#card")
    assert "Weather" not in server.page.inner_text("#card")  # nothing special


def test_a_page_that_is_hidden_pauses(opened: Opened) -> None:
    server = opened()
    page = started(server)
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle > 0.5)
    page.evaluate("""() => {
      Object.defineProperty(document, "hidden", {value: true});
      document.dispatchEvent(new Event("visibilitychange"));
    }""")
    wait_until(page, "document.body.dataset.mode === 'paused'")
    assert page.evaluate("Drive.inputs.control.throttle") == 0


def test_a_slow_simulation_says_so(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(2)
    assert not page.is_visible("#pace")
    server.state, server.extra = FrameState.SLOW, {"factor": 0.8}
    server.drive(2)
    assert page.text_content("#pace") == "simulation runs at 0.80 of real time" and page.is_visible("#pace")


def test_a_collision_is_told_at_once(opened: Opened) -> None:
    server = opened()
    page = started(server)
    server.drive(2)
    assert not page.is_visible("#collision")
    server.extra = {
        "collisions": [
            {"cav": "ego_0", "with": "pedestrian", "id": "walker"},
            {"cav": "ego_0", "with": "vehicle", "id": "ego_1"},
            {"cav": "ego_1", "with": "vehicle", "id": "ego_0"},
            {"cav": "ego_1", "with": "wall", "id": ""},
        ]
    }
    server.drive(2)
    words = "Collision with a pedestrian; Collision with ego_1; ego_1: collision with a wall"
    assert page.inner_text("#collision") == words and page.is_visible("#collision")
    assert page.evaluate(CONTRAST)["below"] == []
    paused(server)
    assert page.is_visible("#collision")
    server.rewind(1, 0)
    wait_until(page, "document.getElementById('collision').hidden")


def test_a_spectator_watches(opened: Opened) -> None:
    server = opened(role="spectator", cav=None)
    page = server.page
    page.evaluate("Drive.connection.ask({do: 'resume'})")
    server.drive(6)
    page.keyboard.press("w")
    server.drive(3)
    assert server.received == []
    assert page.evaluate("Drive.describe(true).centre.index") == 0
    server.drive(1)
    of_first = page.text_content("#clock")
    page.keyboard.press("Tab")
    assert page.evaluate("Drive.describe(true).centre.index") == 1
    server.drive(1)
    assert [of_first[:4], page.text_content("#clock")[:4]] == ["0:44", "0:59"]  # 900 and 1200 ticks
    server.finish()
    wait_until(page, "document.body.dataset.mode === 'finished'")
    assert "87.5\ndriving score, mean of all CAVs" in page.inner_text("#card")


def test_without_webgl_the_top_view_drives(opened: Opened) -> None:
    server = opened()
    page = server.page
    assert page.get_attribute("body", "data-scene") == "top" and page.is_visible("#map")
    assert "the view from above works without it" in (page.text_content("#notice") or "")
    page.keyboard.press("1")
    assert page.evaluate("Drive.picture.view") == "top"
    colours = page.evaluate("""() => {
      const {width, height} = $("map");
      const {data} = $("map").getContext("2d").getImageData(0, 0, width, height);
      const seen = new Set();
      for (let i = 0; i < data.length; i += 404) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
      return [...seen];
    }""")
    assert 0xC9CED6 in colours  # the road of the palette


@pytest.mark.parametrize("size", [(1280, 720), (390, 844), (844, 390)])
def test_every_control_is_there_on_every_window(opened: Opened, size: tuple[int, int]) -> None:
    server = opened(size=size, touch=size[0] < 1000)
    page = started(server)
    server.extra = {"messages": MESSAGES}
    server.drive(2)
    assert page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == list(size)
    covered = page.evaluate(COVERED)
    assert covered == []
    assert page.evaluate(CONTRAST)["below"] == []
    assert page.evaluate("[...document.querySelectorAll('button')].filter((b) => !b.textContent.trim()).length") == 0


def test_fingers_drive(opened: Opened) -> None:
    server = opened(size=(390, 844), touch=True)
    page = server.page
    page.evaluate("$('set-touch').checked || $('set-touch').click()")
    page.click("#card-actions .first")
    wait_until(page, "document.body.dataset.mode === 'driving'")
    box = page.locator("#touch-throttle").bounding_box()
    page.mouse.move(box["x"] + 30, box["y"] + 20)
    page.mouse.down()
    server.drive_until(lambda: server.control.throttle > 0.8)
    page.mouse.up()
    box = page.locator("#touch-wheel").bounding_box()
    page.mouse.move(box["x"] + 84, box["y"] + 10)
    page.mouse.down()
    page.mouse.move(box["x"] + 10, box["y"] + 84, steps=4)
    server.drive_until(lambda: server.control.steer > 0.5 and server.control.throttle == 0)
    assert server.received[-1].device == InputDevice.TOUCH
    page.mouse.up()
    server.drive_until(lambda: server.control.steer == 0)


def test_files_of_the_page() -> None:
    files = read_page_files()
    page = files[PAGE].decode()
    assert [name for name in files if name.endswith(".js") and f'"/static/{name}"' not in page] == []
    assert files["palette.css"].decode().endswith(format_custom_properties())
    assert json.dumps(CAV_COLOURS) in files["palette.js"].decode()
    assert sum(map(len, files.values())) < 2_000_000
    names = [name for name in files if name.endswith((".js", ".html", ".css")) and name != "three.min.js"]
    assert [
        name
        for name in names
        if b"://" in files[name].replace(b"http://www.w3.org/2000/svg", b"").replace(b"://${", b"")
    ] == []
