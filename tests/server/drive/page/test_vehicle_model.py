"""The vehicle model of the page against `vehicle.dynamics`, over random drives; and what prediction makes of it."""

import json
from dataclasses import asdict, astuple
from typing import Any

import numpy as np
import pytest
from testing.chromium import CHROMIUM
from testing.drive_page_files import read_page_files
from testing.paths import TESTS

from mdrive_sumo.contract import Control
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleParameters, VehicleState, step
from server.drive.protocol import STATE_FIELDS

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
DRIVES, TICKS = 1000, 20
WET = VehicleParameters(grip=0.7)
MODEL = """({drives, vehicle, fields}) => drives.map(({state, controls}) => {
  let body = Object.fromEntries(fields.map((name, i) => [name, state[i]]));
  return controls.map(([throttle, brake, steer]) => {
    body = stepVehicle(body, {throttle, brake, steer}, vehicle);
    return fields.map((name) => body[name]);
  });
})"""


@pytest.fixture(scope="module")
def page(browser: Any) -> Any:
    """A tab with the model, the protocol and the prediction."""
    tab = browser.new_page()
    for name in ("vehicle_model.js", "protocol.js", "prediction.js", "input_clock.js"):
        tab.add_script_tag(content=read_page_files()[name].decode())
    return tab


def draw_drives(rng: np.random.Generator, ticks: int = TICKS) -> list[dict[str, Any]]:
    """Random states, also standing, sliding and thrown backwards, and controls that change every few ticks."""
    drives = []
    for _ in range(DRIVES):
        speed = rng.choice([0.0, rng.uniform(-3, 40)], p=[0.2, 0.8])
        state = [
            *rng.uniform(-500, 500, 2).tolist(), float(rng.uniform(-3.14, 3.14)), float(speed),
            float(rng.normal(0, 0.5)), float(rng.normal(0, 0.3)), *rng.uniform(0, 0.7, 3).tolist(), 0.0,
        ]  # fmt: skip
        changes = rng.uniform((0, 0, -1), (1, 1, 1), (ticks // 5, 3)) * (rng.random((ticks // 5, 3)) < 0.7)
        controls = np.repeat(np.round(changes, 4), 5, axis=0)
        drives.append({"state": state, "controls": controls.tolist()})
    return drives


@pytest.mark.slow
def test_the_model_is_that_of_the_simulation(page: Any) -> None:
    """On dry and on wet roads, over 1 000 drives of a second with all that can happen in it."""
    rng = np.random.default_rng(40)
    drives = draw_drives(rng)
    half = DRIVES // 2
    apart = np.concatenate((compare(page, drives[:half], MKZ_2017), compare(page, drives[half:], WET)))
    assert apart.shape == (DRIVES, TICKS, len(STATE_FIELDS))
    assert apart.max() < 1e-6


def compare(page: Any, drives: list[dict[str, Any]], vehicle: VehicleParameters) -> np.ndarray:
    """How far the states of the page's model are from those of the simulation's."""
    given = {"drives": drives, "vehicle": asdict(vehicle), "fields": list(STATE_FIELDS)}
    computed = np.array(json.loads(page.evaluate(f"(given) => JSON.stringify(({MODEL})(given))", given)))
    expected = np.zeros_like(computed)
    for row, drive in enumerate(drives):
        body = VehicleState(*drive["state"])
        for tick, control in enumerate(drive["controls"]):
            body = step(body, Control(*control), vehicle)
            expected[row, tick] = astuple(body)
    apart = np.abs(computed - expected)
    apart[..., 2] = np.abs(np.remainder(apart[..., 2] + np.pi, 2 * np.pi) - np.pi)  # yaws beside the cut at pi
    return apart


SIMULATION = (TESTS / "testing" / "drive_network.js").read_text("utf-8")
ROLLING = dict.fromkeys(STATE_FIELDS, 0.0) | {"vx": 10.0}


def simulate(page: Any, **options: Any) -> dict[str, Any]:
    """Ten seconds of a drive over a network."""
    given = {
        "vehicle": asdict(MKZ_2017),
        "delayMs": 0,
        "jitterMs": 0,
        "seconds": 10,
        "state": ROLLING,
        "stall": None,
        "tickMs": 50,
    }
    return page.evaluate(SIMULATION, given | options)


def measure_steps(pictures: list[dict[str, float]], since_ms: float = 1500) -> tuple[np.ndarray, np.ndarray]:
    """How far the car moves from picture to picture [m], and how far it should at its speed."""
    shown = [picture for picture in pictures if picture["now"] > since_ms]
    x, y, vx = (np.array([picture[name] for picture in shown]) for name in ("x", "y", "vx"))
    return np.hypot(np.diff(x), np.diff(y)), (vx[1:] + vx[:-1]) / 2 * 0.016


@pytest.mark.parametrize("delay_ms", [0, 75, 150])
def test_what_is_predicted_is_what_is_simulated(page: Any, delay_ms: int) -> None:
    """Exact, as soon as the inputs fill the way to the server: nothing is ever corrected."""
    run = simulate(page, delayMs=delay_ms)
    filled = 2 * delay_ms // 50 + 2
    common = [number for number in run["simulated"] if number in run["predicted"] and int(number) > filled]
    assert len(common) > 150
    apart = [abs(run["simulated"][n][f] - run["predicted"][n][f]) for n in common for f in ("x", "y", "vx", "drive")]
    assert max(apart) < 1e-9


@pytest.mark.parametrize(("delay_ms", "jitter_ms", "limit_m"), [(0, 0, 0.02), (75, 0, 0.02), (75, 40, 0.08)])
def test_pictures_move_smoothly(page: Any, delay_ms: int, jitter_ms: int, limit_m: float) -> None:
    moved, due = measure_steps(simulate(page, delayMs=delay_ms, jitterMs=jitter_ms)["pictures"])
    assert np.abs(moved - due).max() < limit_m
    assert moved.sum() == pytest.approx(due.sum(), rel=0.02)


@pytest.mark.parametrize("tick_ms", [62, 100])
def test_a_slow_simulation_is_seen_in_slow_motion(page: Any, tick_ms: int) -> None:
    moved, due = measure_steps(simulate(page, delayMs=20, tickMs=tick_ms)["pictures"], 3000)
    assert np.abs(moved - due * 50 / tick_ms).max() < 0.03


def test_a_pedal_acts_in_the_next_picture(page: Any) -> None:
    pictures = simulate(page, delayMs=150)["pictures"]
    first = next(picture["now"] for picture in pictures if picture["drive"] > 0)
    assert 1000 < first <= 1016 + 16


def test_a_delay_that_ends_leaves_no_inputs_on_the_way(page: Any) -> None:
    """Frames that come late for half a second: driving goes on, and afterwards the reaction is as quick as before."""
    quiet, late = simulate(page, delayMs=20), simulate(page, delayMs=20, seconds=25, stall=[4000, 4500])
    moved, due = measure_steps(late["pictures"], 4600)
    assert late["mostWaiting"] <= quiet["mostWaiting"] + 1
    assert np.abs(moved - due)[60:].max() < 0.08
    assert late["repeated"] <= quiet["repeated"] + 12
