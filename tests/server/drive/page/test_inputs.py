"""Keyboard, gamepad, wheel, calibration and assisted steering of the drive page."""

import json
from dataclasses import asdict
from typing import Any

import pytest
from testing.chromium import CHROMIUM, wait_until
from testing.drive_page_files import read_page_files
from testing.drive_page_server import make_route

from mdrive_sumo.vehicle.dynamics import MKZ_2017
from server.drive.protocol import InputDevice
from tests.server.drive.page.conftest import Opened
from tests.server.drive.page.test_drive_page import started

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
SCRIPTS = (
    "page_parts.js", "vehicle_model.js", "protocol.js", "route.js", "keyboard.js", "gamepad.js", "calibration.js",
)  # fmt: skip
FAKE_PAD = """
  window.pads = [];
  navigator.getGamepads = () => window.pads;
  window.makePad = (options = {}) => ({
    index: 0, connected: true, id: "Racing Wheel (Vendor: 1)", mapping: "", axes: [0, 1, 1], buttons: [{value: 0}],
    ...options,
  });
"""
PAD = {
    "id": "Pad", "mapping": "standard", "index": 0, "connected": True, "axes": [0, 0, 0, 0],
    "buttons": [{"value": 0}] * 17,
}  # fmt: skip


@pytest.fixture(scope="module")
def page(browser: Any) -> Any:
    """A tab with the scripts of inputs, and the vehicle as `mkz`."""
    tab = browser.new_page()
    for name in SCRIPTS:
        tab.add_script_tag(content=read_page_files()[name].decode())
    tab.evaluate("(vehicle) => { globalThis.mkz = vehicle; }", asdict(MKZ_2017))
    return tab


# ------------------------------------------------------------------------------------------------------------ keyboard


def test_keys_reach_the_limit_and_the_centre_in_the_stated_times(page: Any) -> None:
    times = page.evaluate("""() => {
      const keyboard = new Keyboard();
      const until = (isReached) => {
        let time = 0;
        while (!isReached(keyboard.control) && time < 5) { keyboard.read(0.01, 0, mkz); time += 0.01; }
        return time;
      };
      keyboard.press("KeyA", true);
      const out = until(({steer}) => steer === 1);
      keyboard.press("KeyA", false);
      const back = until(({steer}) => steer === 0);
      keyboard.press("ArrowUp", true);
      const down = until(({throttle}) => throttle === 1);
      keyboard.press("Space", true);
      return [out, back, down, until(({brake}) => brake === 1)];
    }""")
    assert times == pytest.approx([0.5, 0.3, 0.4, 0.01], abs=0.011)


def test_the_wheel_has_less_way_at_speed(page: Any) -> None:
    limits = page.evaluate("[0, 2, 5, 10, 20, 40].map((speed) => steerLimit(speed, mkz))")
    assert limits[0] == limits[1] == 1.0
    assert limits == sorted(limits, reverse=True) and limits[-1] > 0
    held = page.evaluate("""() => {
      let body = {x: 0, y: 0, yaw: 0, vx: 15, vy: 0, yaw_rate: 0, steer_angle: 0, drive: 0, brake: 0, acceleration: 0};
      const keyboard = new Keyboard();
      keyboard.press("KeyD", true);
      let most = 0;
      for (let i = 0; i < 60; i++) {
        body = stepVehicle(body, keyboard.read(0.05, body.vx, mkz), mkz);
        most = Math.max(most, Math.abs(body.yaw_rate * body.vx));
      }
      return most;
    }""")
    assert held == pytest.approx(4.0, abs=0.6)  # m/s2: a key held down does not throw the car


def test_left_is_left_and_both_are_none(page: Any) -> None:
    steer = """(codes) => {
      const keyboard = new Keyboard();
      codes.forEach((code) => keyboard.press(code, true));
      return keyboard.read(0.1, 0, mkz).steer;
    }"""
    assert page.evaluate(steer, ["KeyA"]) > 0 > page.evaluate(steer, ["ArrowRight"])
    assert page.evaluate(steer, ["KeyA", "KeyD"]) == 0
    assert page.evaluate(steer, ["KeyA", "ShiftLeft"]) == pytest.approx(page.evaluate(steer, ["KeyA"]) / 2)


# ------------------------------------------------------------------------------------------------------- gamepad, wheel


@pytest.mark.parametrize(
    ("axis", "steer"),
    [(0.0, 0.0), (0.07, 0.0), (-0.05, 0.0), (-1.0, 1.0), (1.0, -1.0), (-0.54, 0.5**1.6)],
    ids=["rests", "dead zone", "dead zone left", "left end", "right end", "linearity"],
)
def test_a_standard_gamepad(page: Any, axis: float, steer: float) -> None:
    pad = {**PAD, "axes": [axis, 0, 0, 0], "buttons": [{"value": 0}] * 7 + [{"value": 0.5}] + [{"value": 0}] * 9}
    control = page.evaluate("(pad) => readCalibrated(pad, STANDARD)", pad)
    assert control["steer"] == pytest.approx(steer, abs=0.002)
    assert control["throttle"] == pytest.approx(0.5, abs=0.03) and control["brake"] == 0


REST = {"steer": 0.1, "throttle": 1.0, "brake": 1.0}
DEVICES = {
    "inverted pedals": [[0.1, 1, 1], [-1, 1, 1], [1, 1, 1], [0.1, -1, 1], [0.1, 1, -1]],
    "inverted wheel": [[0.1, -1, -1], [1, -1, -1], [-1, -1, -1], [0.1, 1, -1], [0.1, -1, 1]],
    "combined pedals": [[0.1, 0, 0], [-1, 0, 0], [1, 0, 0], [0.1, -1, 0], [0.1, 1, 0]],
    "another order": [[0, 0, 0.1], [0, 0, -1], [0, 0, 1], [0, 1, 0.1], [1, 0, 0.1]],
}
"""Axes while resting, fully left, fully right, with the throttle and with the brake pressed."""
CALIBRATED = """(readings) => {
  const pad = {id: "Wheel", mapping: "", axes: readings[0], buttons: []};
  const keys = ["rest", "left", "right", "throttle", "brake"];
  const calibration = buildCalibration(pad, Object.fromEntries(keys.map((key, i) => [key, readings[i]])));
  return [isCalibration(calibration), ...readings.map((axes) => readCalibrated({...pad, axes}, calibration))];
}"""


@pytest.mark.parametrize("name", DEVICES)
def test_calibration_finds_axes_signs_and_combined_pedals(page: Any, name: str) -> None:
    is_valid, rest, left, right, throttle, brake = page.evaluate(CALIBRATED, DEVICES[name])
    assert is_valid
    assert list(rest.values()) == pytest.approx([0, 0, 0])
    assert (left["steer"], right["steer"]) == (1, -1)
    assert list(throttle.values()) == pytest.approx([1, 0, 0]) and list(brake.values()) == pytest.approx([0, 1, 0])


@pytest.mark.parametrize(
    ("readings", "sentence"),
    [
        ([[0, 0, 0]] * 5, "Nothing moved for: steering."),
        ([[0, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 1]], "Nothing moved for: throttle."),
        ([[0, 0, 0], [-1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 1]], "The wheel moved while a pedal was asked for."),
    ],
)
def test_a_wrong_calibration_says_why(page: Any, readings: list[list[float]], sentence: str) -> None:
    caught = page.evaluate(
        f"(r) => {{ try {{ ({CALIBRATED})(r); }} catch (error) {{ return error.message; }} }}", readings
    )
    assert caught.startswith(sentence)


@pytest.mark.slow
def test_a_damaged_store_is_as_if_empty(opened: Opened) -> None:
    page = opened().page
    numbers = json.dumps({"steer": 1, "throttle": 2, "brake": 3})
    for stored in ("{", "null", "{}", "[]", '{"steer": {"axis": 0}}', numbers, '"text"'):
        page.evaluate("(text) => localStorage.setItem('mdrive-sumo drive calibration Pad', text)", stored)
        page.evaluate("(text) => localStorage.setItem('mdrive-sumo drive mirrors', text)", stored)
        assert page.evaluate("loadCalibration({id: 'Pad', mapping: 'standard', axes: []}) === STANDARD"), stored
        page.reload()
        wait_until(page, "document.body.dataset.scene")


@pytest.mark.slow
def test_a_wheel_is_calibrated_and_remembered_and_the_keyboard_takes_over(opened: Opened) -> None:
    server = opened(script=FAKE_PAD)
    page = started(server)
    page.evaluate("pads[0] = makePad()")
    server.drive(2)
    assert page.text_content("#notice") == (
        "Racing Wheel is not calibrated: open the settings and follow the steps. The keyboard drives."
    )
    page.click("#do-settings")
    page.click("#pad-calibrate")
    for axes in ([0, 1, 1], [-1, 1, 1], [1, 1, 1], [0, -1, 1], [0, 1, -1]):
        page.evaluate("(axes) => { pads[0] = makePad({axes}); }", axes)
        page.click("#pad-next")
    assert page.text_content("#pad-step") == "Done. It is remembered in this browser."
    page.keyboard.press("Escape")
    page.evaluate("pads[0] = makePad()")
    server.drive(2)
    page.evaluate("pads[0] = makePad({axes: [-0.5, -1, 1]})")
    server.drive_until(lambda: server.control.throttle == 1.0 and server.control.steer == pytest.approx(0.5))
    assert server.received[-1].device == InputDevice.WHEEL
    page.evaluate("pads[0] = makePad({axes: [NaN, -1, 1]})")
    server.drive_until(lambda: server.control.throttle == 0.0)
    assert page.text_content("#notice") == "Racing Wheel: axis 0 gives no number. The keyboard drives."
    page.keyboard.down("w")
    server.drive_until(lambda: server.control.throttle > 0)
    page.keyboard.up("w")
    page.reload()
    wait_until(page, "document.body.dataset.scene")
    assert page.evaluate("loadCalibration(makePad()).throttle") == {"axis": 1, "rest": 1, "full": -1}


@pytest.mark.slow
def test_a_gamepad_that_goes_is_told(opened: Opened) -> None:
    server = opened(script=FAKE_PAD)
    page = started(server)
    page.evaluate("(pad) => { pads[0] = pad; }", PAD)
    server.drive(2)
    page.evaluate("pads[0] = {...pads[0], axes: [-1, 0, 0, 0]}")
    server.drive_until(lambda: server.control.steer == 1.0)
    assert server.received[-1].device == InputDevice.GAMEPAD
    page.evaluate("pads[0] = null")
    server.drive_until(lambda: server.control.steer == 0.0)
    assert page.text_content("#notice") == "Pad is gone. The keyboard drives."


# --------------------------------------------------------------------------------------------------- route, assistance


def test_the_route_tells_the_next_manoeuvre(page: Any) -> None:
    told = page.evaluate(
        """(points) => {
          const route = new Route(points, points.map(() => 13.9));
          const ends = [0, 100, 139, 145, 170].map((place) => route.nextAfter(place).kind);
          return [ends, route.manoeuvres, route.length, route.limitAt(50), route.locate(-100, 5)];
        }""",
        make_route(),
    )
    kinds, turns, length, limit, located = told
    assert kinds == ["left", "left", "left", "left", "goal"]
    assert len(turns) == 1 and turns[0]["from"] == pytest.approx(138, abs=2) and turns[0]["to"] < 168
    assert length == pytest.approx(138 + 21.6 + 138, abs=2) and limit == 13.9
    assert located == {"place": pytest.approx(50, abs=0.1), "apart": pytest.approx(6.75)}


@pytest.mark.parametrize(
    ("points", "kinds"),
    [
        ([[0, 0], [100, 0]], []),
        ([[0, 0], [50, 0], [50, -50]], ["right"]),
        ([[0, 0], [50, 0], [100, 14], [150, 40]], []),
        ([[0, 0], [50, 0], [58, 4], [58, 12], [50, 16], [0, 16]], ["turn-round"]),
        ([[0, 0], [50, 0], [50, 50], [100, 50]], ["left", "right"]),
        ([[0, 0], [0, 0], [50, 0]], []),
    ],
    ids=["straight", "right", "a bend", "U-turn", "left and right", "a point twice"],
)
def test_turns_of_routes(page: Any, points: list[list[float]], kinds: list[str]) -> None:
    assert page.evaluate("(points) => new Route(points).manoeuvres.map(({kind}) => kind)", points) == kinds


@pytest.mark.parametrize("speed", [4.0, 7.0])
def test_assisted_steering_keeps_the_lane(page: Any, speed: float) -> None:
    apart = page.evaluate(
        """([points, speed]) => {
          const route = new Route(points);
          let body = Object.fromEntries(STATE_FIELDS.map((name) => [name, 0]));
          Object.assign(body, {x: -148, y: -1.75, vx: speed});
          let most = 0;
          while (route.locate(body.x, body.y).place < route.length - 20) {
            const throttle = Math.min(1, Math.max(0, speed - body.vx));
            body = stepVehicle(body, {throttle, brake: 0, steer: steerAlong(route, body, mkz)}, mkz);
            most = Math.max(most, route.locate(body.x, body.y).apart);
          }
          return most;
        }""",
        [make_route(), speed],
    )
    assert apart < 0.6
