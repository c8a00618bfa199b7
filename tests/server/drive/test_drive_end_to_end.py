"""`mdrive-sumo drive` as people use it: a browser, keys, the goal, a branch, an agent, two verified takes."""

import json
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_flags
from testing.drive_command import KeyDriver, drive_folder, list_takes, run_command, run_drive

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]

SCENARIO = "i11_ins_sl_town"
"""Its CAV 0 has 40 m to its goal, past a hidden street: some 9 s at 5 m/s."""


@pytest.fixture(scope="module")
def browser() -> Generator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=list_flags())
        yield opened
        opened.close()


def wait_for(page: Any, is_done: Callable[[], bool], limit_s: float = 120.0) -> None:
    end = time.monotonic() + limit_s
    while not is_done():
        assert time.monotonic() < end, page.evaluate("JSON.stringify([{...document.body.dataset}, Drive.listed])")
        page.wait_for_timeout(50)


def has_arrived(page: Any) -> bool:
    return page.evaluate("Drive.endings['0']") == "arrived"


def finish(page: Any, driver: KeyDriver) -> None:
    """End a take whose own drive is over, without waiting for the others."""
    page.keyboard.press("p")
    wait_for(page, lambda: driver.mode in ("paused", "finished"))
    if driver.mode == "paused":
        page.click("#do-finish")
    wait_for(page, lambda: driver.mode == "finished")


@pytest.mark.full
def test_a_person_drives_to_the_goal_goes_back_and_hands_over(browser: Any, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    trouble: list[str] = []
    with run_drive(SCENARIO, "--out", folder) as command:
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.on("response", lambda answer: trouble.append(answer.url) if answer.status >= 400 else None)
        page.goto(command.links["0"])
        driver = KeyDriver(page)
        driver.start()
        driver.drive_until(lambda: has_arrived(page))
        finish(page, driver)
        wait_for(page, lambda: list_takes(page)[0]["score"] is not None)

        page.evaluate("Drive.card.hide()")
        page.evaluate("$('time').value = 60; $('time').dispatchEvent(new Event('input'))")
        page.click("#do-branch")
        wait_for(page, lambda: driver.take == 2)
        assert driver.tick == 60
        driver.start()
        driver.drive_until(lambda: driver.tick > 80)
        page.keyboard.press("o")
        wait_for(page, lambda: bool(page.evaluate("Drive.isAgentDriving")))
        wait_for(page, lambda: bool(page.evaluate("'0' in Drive.endings")))
        finish(page, driver)
        wait_for(page, lambda: all(take["score"] is not None for take in list_takes(page)))
        told = list_takes(page)
        page.close()
        command.stop()
    assert trouble == []
    assert [(take["number"], take["parent"], take["tick"]) for take in told] == [(1, None, 0), (2, 1, 60)]
    assert told[0]["ds"]["0"] > 0.0
    for take in told:
        run = drive_folder(folder, take["number"])
        results = json.loads((run / "results.json").read_text())
        assert results["run"]["agent"] == "human"
        assert "i11_ins_sl_town: identical" in run_command("verify", run)
