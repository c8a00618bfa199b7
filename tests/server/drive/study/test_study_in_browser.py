"""A participant in a real browser: consent, a drive by keys over the real simulation, questions, thanks."""

import csv
import signal
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, list_flags
from testing.drive_command import START_S, KeyDriver, run_command
from testing.human_study import SECOND, write_plan
from testing.paths import ROOT

from mdrive_sumo.study.human.human_results import format_drives_csv
from mdrive_sumo.study.human.write_human_results import load_stored_human_results

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
CODE_FOLDER = f"participants/P01/drives/00-{SECOND}"


@pytest.fixture
def page() -> Generator[Any]:
    """A tab without WebGL, in which the top view is drawn: 14 s of processor time for the test instead of 20."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=[*list_flags(), "--disable-3d-apis"])
        yield browser.new_page(viewport={"width": 800, "height": 600})
        browser.close()


@pytest.fixture
def served(tmp_path: Path) -> Generator[tuple[Path, str]]:
    """The folder of a study of one drive, and the organiser's link; ended as Ctrl-C does."""
    folder = tmp_path / "study"
    plan = write_plan(tmp_path, participants=1, scenarios=[SECOND], conditions=[{"name": "view"}])
    words = ["study", "human", "--plan", str(plan), "--out", str(folder), "--no-open", "--port", "0"]
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-m", "mdrive_sumo", *words], stdout=pipe, stderr=pipe, text=True, cwd=ROOT
    )
    try:
        assert process.stdout is not None
        link = process.stdout.readline().split()[-1]
        yield folder, link
        process.send_signal(signal.SIGINT)
        assert process.wait(START_S) == 0
    finally:
        process.kill()
        process.communicate()


def test_a_participant_drives_and_is_a_person_in_the_table(served: tuple[Path, str], page: Any) -> None:
    folder, link = served
    trouble: list[str] = []
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("response", lambda answer: trouble.append(answer.url) if answer.status >= 400 else None)
    page.goto(link)
    page.click("td a")
    page.check("input[name=agree]")
    page.click("text=Begin")
    page.click("text=Begin the drive")
    page.wait_for_url("**/drive/**", timeout=1000 * START_S)
    driver = KeyDriver(page)
    driver.start()
    driver.drive_until(lambda: page.evaluate("'0' in Drive.endings"))
    page.click("text=Back to the study")
    page.wait_for_selector("fieldset", timeout=1000 * START_S)
    page.check("input[value='6']")
    page.click("text=Send the answers")
    page.click("text=Send the answers")
    assert page.inner_text("h1") == "Thank you"
    assert trouble == []
    take = folder / CODE_FOLDER / "takes" / "1"
    assert f"{SECOND}: identical" in run_command("verify", take, "--workers", "1")
    (row,) = csv.DictReader(format_drives_csv(load_stored_human_results(folder)).splitlines())
    assert (row["driver"], row["device"], row["outcome"], row["answer_safe"]) == ("person", "keyboard", "arrived", "6")
