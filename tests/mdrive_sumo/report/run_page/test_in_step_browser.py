"""Two replays in step, in a browser: one time, one view, the tick where they part, and nothing from outside."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, open_quietly
from testing.viewer_crossing import crossing, record, scenario, some_marks

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.report.run_page.in_step_page import APART_M, InStepSide, render_in_step
from mdrive_sumo.runs.episode_difference import find_parting, find_separation

pytestmark = pytest.mark.slow
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
TICKS, PARTED, APART = 60, 20, 30
HOSTILE = '"></iframe><img src=x onerror=alert(1)>'
STATE = "[viewer.tick, ...Object.values(viewer.view).map((value) => Math.round(10 * value))]"


def sideways(episode: EpisodeRecord) -> EpisodeRecord:
    """The same episode with its first CAV 1 cm to the side from tick `PARTED`, 2 m from tick `APART`."""
    quanta = episode.quanta.copy()
    quanta[PARTED:, 0, 1] += 10
    quanta[APART:, 0, 1] += 2000
    return replace(episode, quanta=quanta)


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    a = record(TICKS)
    episodes = (a, sideways(a))
    sides = [
        InStepSide(
            letter, HOSTILE, "runs/x", 60.0, render_replay(one, scenario(2), crossing(), some_marks(TICKS, HOSTILE))
        )
        for letter, one in zip("AB", episodes, strict=True)
    ]
    path = tmp_path_factory.mktemp("step") / "x-AB.html"
    page = render_in_step("crossing-4", "", sides, find_parting(*episodes), find_separation(*episodes, APART_M))
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, page_file: Path) -> Iterator[Any]:
    for tab in open_quietly(browser, page_file.as_uri(), (1200, 800)):
        in_both(tab, 0)
        yield tab


def in_both(tab: Any, tick: int) -> list[list[float]]:
    """Wait until both replays show a tick; their ticks and views."""
    end = time.monotonic() + 30
    while True:
        ready = tab.evaluate("player.ready.length") == 2
        found = [frame.evaluate(STATE) for frame in tab.frames[1:]] if ready else []
        if [state[0] for state in found] == [tick, tick] and found[0] == found[1]:
            return found
        assert time.monotonic() < end, f"not in step at tick {tick}: {found}"
        tab.wait_for_timeout(25)


@needs_browser
def test_both_replays_follow_one_time(page: Any) -> None:
    assert "They part at t = 1.00 s (tick 20): CAV cav_0 has y" in page.inner_text("#parting")
    page.keyboard.press("g")
    in_both(page, PARTED)
    page.keyboard.press("Shift+G")
    in_both(page, APART)
    page.click(".marks[data-side='1'] .mark.bad >> nth=0")
    in_both(page, TICKS // 2)
    page.fill("#slider", "7")
    in_both(page, 7)
    page.keyboard.press("Home")
    page.click("#play")
    in_both(page, TICKS - 1)
    assert page.inner_text("#time") == f"{(TICKS - 1) / 20:.2f}"


@needs_browser
def test_what_happens_in_one_replay_happens_in_both(page: Any) -> None:
    first = page.frame_locator("iframe").first
    before = in_both(page, 0)
    first.locator(".event").first.click()
    in_both(page, TICKS // 4)
    first.locator("#map").press("ArrowRight")
    in_both(page, TICKS // 4 + 1)
    first.locator("body").press("g")
    in_both(page, PARTED)
    first.locator("body").press("+")
    assert in_both(page, PARTED)[1][3] > before[1][3]
    page.click("#fit")
    assert in_both(page, PARTED)[1][1:] == before[1][1:]


@needs_browser
def test_a_link_leads_to_a_tick_and_a_phone_shows_both(browser: Any, page_file: Path) -> None:
    for tab in open_quietly(browser, f"{page_file.as_uri()}#t=1.25", (390, 844)):
        in_both(tab, 25)
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        for i in (0, 1):
            box = tab.locator("iframe").nth(i).bounding_box()
            assert box["width"] > 300 and box["height"] > 220 and box["y"] + box["height"] < 844
        shown = [
            frame.evaluate("getComputedStyle(document.getElementById('dock')).display") for frame in tab.frames[1:]
        ]
        assert shown == ["none", "none"]
