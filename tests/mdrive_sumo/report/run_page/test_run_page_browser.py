"""Pages of runs in a browser: filters, keyboard, deep links, a phone; two replays that keep one time and one view."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, open_quietly, wait_until
from testing.view_runs import make_run
from testing.viewer_crossing import crossing, record, scenario, some_marks

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.report.run_page.in_step_page import APART_M, InStepSide, render_in_step
from mdrive_sumo.report.run_page.run_page import render_run_page
from mdrive_sumo.report.run_page.run_page_data import build_run_page_data
from mdrive_sumo.runs.episode_difference import find_parting, find_separation
from mdrive_sumo.runs.stored_run import load_stored_run

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
SHOWN = "[...document.querySelectorAll('.scenario:not([hidden]) h3')].map((node) => node.textContent)"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("story")
    path = folder / "index.html"
    stored = load_stored_run(make_run(folder, "--seeds", "2"))
    path.write_text(render_run_page(build_run_page_data(stored, {("s0", 1): ()}, path)), encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, page_file: Path) -> Iterator[Any]:
    yield from open_quietly(browser, page_file.as_uri())


@needs_browser
def test_filters_show_what_fits_and_stay_in_the_address(page: Any, page_file: Path) -> None:
    assert page.evaluate(SHOWN) == ["s0", "s2", "s1"]
    page.select_option("#outcome", "success")
    assert page.evaluate(SHOWN) == ["s1"]
    page.click("#clear")
    page.select_option("#kind", "collision-vehicle")
    assert page.evaluate(SHOWN) == ["s0"]
    assert page.url.endswith("#kind=collision-vehicle")
    page.goto(f"{page_file.as_uri()}#crashed=1")
    wait_for_rows(page, 1)  # the page hears of a new address a little later
    assert page.evaluate(SHOWN) == ["s2"] and page.is_checked("#crashed")
    assert page.inner_text("#count") == "1 of 3 scenarios, 2 of 6 episodes"
    page.goto(f"{page_file.as_uri()}#bucket=Tiny&category=deed&kind=nonsense")
    wait_for_rows(page, 3)


def wait_for_rows(page: Any, count: int) -> None:
    """Wait until the table shows so many scenarios."""
    wait_until(page, f"({SHOWN}).length === {count}")


@needs_browser
def test_the_keyboard_searches_and_reaches_every_link(page: Any) -> None:
    page.keyboard.press("/")
    page.keyboard.type("HIT vehicle")
    assert page.evaluate(SHOWN) == ["s0"]
    page.keyboard.press("Control+A")
    page.keyboard.type("nothing like it")
    assert page.evaluate(SHOWN) == [] and page.is_visible("#nothing")
    page.keyboard.press("Control+A")
    page.keyboard.press("Delete")
    reached = set[str]()
    for _ in range(20):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.getAttribute('href') ?? document.activeElement.id"))
    assert {"clear", "s0-seed1.html", "s0-seed1.html#t=1.50"} <= reached


@needs_browser
def test_the_overview_leads_to_a_scenario_that_filters_hide(page: Any) -> None:
    squares = page.locator(".overview a")
    assert [squares.nth(i).get_attribute("href") for i in range(3)] == ["#s-s0", "#s-s2", "#s-s1"]
    page.select_option("#outcome", "success")
    assert page.locator(".overview li.faded").count() == 2
    squares.first.click()
    page.wait_for_timeout(50)
    assert len(page.evaluate(SHOWN)) == 3 and page.input_value("#outcome") == ""
    assert page.url.endswith("#s-s0")


@needs_browser
def test_failures_have_a_button(page: Any) -> None:
    page.click("#show-failures")
    assert page.evaluate(SHOWN) == ["s2"]
    page.click("#s-s2 .why summary >> nth=0")
    assert "Traceback" in page.inner_text("#s-s2 pre >> nth=0")


@needs_browser
@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_the_page_fits_its_window(page: Any, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]


# ---- two replays in step

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
def step_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
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
def step(browser: Any, step_file: Path) -> Iterator[Any]:
    for tab in open_quietly(browser, step_file.as_uri(), (1200, 800)):
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


def in_both_at_rest(tab: Any, tick: int) -> list[list[float]]:
    """As `in_both`, once the views no longer change: orders reach the replays as messages."""
    found: list[list[float]] = []
    while (now := in_both(tab, tick)) != found:
        found = now
        tab.wait_for_timeout(200)
    return found


@needs_browser
def test_the_map_has_most_of_each_side(step: Any) -> None:
    """The panel of a replay begins folded beside another one: below the map it would cover a third."""
    for frame in step.frames[1:]:
        wait_until(frame, "window.viewer && document.body.classList.contains('panel-folded')")
        assert frame.evaluate("document.getElementById('panel').offsetHeight") < 60
        assert frame.evaluate("document.getElementById('stage').clientHeight / innerHeight") > 0.8
        frame.click("#panel-fold")
        assert frame.is_visible("#events")


@needs_browser
def test_both_replays_follow_one_time(step: Any) -> None:
    assert "They part at t = 1.00 s (tick 20): CAV cav_0 has y" in step.inner_text("#parting")
    step.keyboard.press("g")
    in_both(step, PARTED)
    step.keyboard.press("Shift+G")
    in_both(step, APART)
    step.keyboard.press("n")
    in_both(step, int(0.7 * TICKS))
    step.keyboard.press("p")
    in_both(step, TICKS // 2)
    step.keyboard.press("p")
    in_both(step, TICKS // 4)
    step.click(".marks[data-side='1'] .mark.bad >> nth=0")
    in_both(step, TICKS // 2)
    step.fill("#slider", "7")
    in_both(step, 7)
    step.keyboard.press("Home")
    step.select_option("#rate", "8")
    step.click("#play")
    in_both(step, TICKS - 1)
    assert step.inner_text("#time") == f"{(TICKS - 1) / 20:.2f}"


@needs_browser
def test_what_happens_in_one_replay_happens_in_both(step: Any) -> None:
    first = step.frame_locator("iframe").first
    first.locator("#panel-fold").click()
    first.locator(".event").first.click()
    first.locator("#panel-fold").click()
    before = in_both_at_rest(step, TICKS // 4)
    first.locator("#map").press("ArrowRight")
    in_both(step, TICKS // 4 + 1)
    first.locator("body").press("g")
    in_both(step, PARTED)
    first.locator("body").press("+")
    assert in_both_at_rest(step, PARTED)[1][3] > before[1][3]
    step.click("#fit")
    assert in_both_at_rest(step, PARTED)[1][1:] == before[1][1:]


@needs_browser
def test_a_link_leads_to_a_tick_and_a_phone_shows_both(browser: Any, step_file: Path) -> None:
    for tab in open_quietly(browser, f"{step_file.as_uri()}#t=1.25", (390, 844)):
        in_both(tab, 25)
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        for i in (0, 1):
            box = tab.locator("iframe").nth(i).bounding_box()
            assert box["width"] > 300 and box["height"] > 220 and box["y"] + box["height"] < 844
        shown = [
            frame.evaluate("getComputedStyle(document.getElementById('dock')).display") for frame in tab.frames[1:]
        ]
        assert shown == ["none", "none"]
