"""The 3-D view of a replay page: what the page carries for it, and how it works in a browser."""

import base64
import gzip
import hashlib
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.chromium import CHROMIUM, open_quietly, wait_until
from testing.viewer_crossing import crossing, record, scenario, some_marks

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.report.replay_scene import list_looks, tabulate_lamps
from mdrive_sumo.report.run_page.in_step_page import InStepSide, render_in_step
from mdrive_sumo.report.view_3d_script import build_view_3d_script
from mdrive_sumo.sensing.signal_lamps import SignalLamp

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

TICKS = 60
SMALL = (800, 450)
"""Few pixels, because the processor draws them."""
WITHOUT_WEBGL = """
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  return kind.startsWith("webgl") ? null : getContext.call(this, kind, options);
};
"""


@pytest.fixture(scope="module")
def episode() -> EpisodeRecord:
    return record(TICKS, egos=4, actors=20)


@pytest.fixture(scope="module")
def replay_file(tmp_path_factory: pytest.TempPathFactory, episode: EpisodeRecord) -> Path:
    path = tmp_path_factory.mktemp("view") / "replay.html"
    path.write_text(render_replay(episode, scenario(4), crossing(), some_marks(TICKS)), encoding="utf-8")
    return path


def read_block(page: str, name: str) -> str:
    found = re.search(rf'id="{name}">([A-Za-z0-9+/=]+)</script>', page)
    assert found
    return found[1]


def test_the_page_carries_the_script_that_its_policy_names(replay_file: Path) -> None:
    """Also in a frame beside another replay, where the policy of the outer page holds as well."""
    page = replay_file.read_text("utf-8")
    script = gzip.decompress(base64.b64decode(read_block(page, "view-3d-script")))
    assert script.decode() == build_view_3d_script()
    sides = [InStepSide(name, "", "runs/x", 60.0, page) for name in "AB"]
    policies = (page, render_in_step("crossing-4", "", sides, None, None))
    digest = base64.b64encode(hashlib.sha256(script).digest()).decode()
    assert all(f"'sha256-{digest}'" in text.partition("style-src")[0] for text in policies), (
        "also beside another replay"
    )


def test_the_page_grows_by_little(replay_file: Path) -> None:
    """Measured: 203 kB of script, packed, and 8 kB of scene; of a packaged network up to 30 kB."""
    page = replay_file.read_text("utf-8")
    assert len(read_block(page, "view-3d-script")) < 220_000
    assert len(read_block(page, "scene")) < 30_000


def test_road_users_have_looks_and_lamps(episode: EpisodeRecord) -> None:
    looks = list_looks(episode)
    assert looks[0].model == "car" and {look.model for look in looks} >= {"car", "cyclist", "pedestrian", "obstacle"}
    quanta = episode.quanta.copy()
    quanta[20:40, 0, 3] = 9000 - 150 * np.arange(20)  # 3 m/s2, in mm/s
    lamps = tabulate_lamps(replace(episode, quanta=quanta), crossing())
    assert lamps.shape == (len(episode.ids), TICKS // 4)
    assert lamps[0, 9] == SignalLamp.BRAKE and not lamps[0, :5].any() and not lamps[2].any()


@pytest.fixture
def page(gl_browser: Any, replay_file: Path) -> Iterator[Any]:
    for tab in open_quietly(gl_browser, replay_file.as_uri(), SMALL):
        wait_until(tab, "window.viewer !== undefined")
        yield tab


@needs_browser
def test_it_shows_what_the_selected_cav_is_in_the_middle_of_in_all_modes(page: Any, episode: EpisodeRecord) -> None:
    page.keyboard.press("d")
    wait_until(page, "viewer.space.view !== undefined && viewer.space.drawn !== undefined")
    assert page.locator("#view-3d").is_visible() and page.locator("#toggle-3d").get_attribute("aria-pressed") == "true"
    assert page.evaluate("viewer.space.view.info.triangles") > 1000
    page.evaluate("viewer.seek(30)")
    wait_until(page, "viewer.space.drawn.startsWith('30,')")
    pose = page.evaluate("viewer.space.view.pose")
    origin = page.evaluate("viewer.replay.origin")
    assert pose["x"] + origin[0] == pytest.approx(float(episode.x[30, 0]), abs=0.002)
    assert pose["y"] + origin[1] == pytest.approx(float(episode.y[30, 0]), abs=0.002)
    assert page.evaluate("viewer.space.view.users.users.size") == episode.valid[30].sum()
    page.locator(".choose").nth(2).click()
    wait_until(page, "viewer.space.view.pose.own === 2")
    names: list[str] = []
    for _ in range(4):
        names.append(page.locator("#view-mode").inner_text())
        page.keyboard.press("e")
    assert names == ["Chase", "Driver", "Mirrors", "Cameras"]
    page.keyboard.press("d")
    assert page.locator("#space").is_hidden() and page.locator("#map").is_visible()
    page.locator("#toggle-3d").click()
    assert page.locator("#space").is_visible()
    page.keyboard.press("?")
    assert "3-D view" in page.locator("#help").inner_text()


@needs_browser
def test_without_webgl_a_sentence_says_so_and_the_map_stays(gl_browser: Any, replay_file: Path) -> None:
    tab = gl_browser.new_page(viewport={"width": SMALL[0], "height": SMALL[1]})
    tab.add_init_script(WITHOUT_WEBGL)
    tab.goto(replay_file.as_uri())
    wait_until(tab, "window.viewer !== undefined")
    tab.keyboard.press("d")
    tab.locator("#no-3d").wait_for(state="visible")
    assert tab.locator("#no-3d").inner_text().startswith("This browser has no WebGL 2")
    assert tab.locator("#toggle-3d").is_disabled() and tab.locator("#view-3d").is_hidden()
    tab.keyboard.press("ArrowRight")
    wait_until(tab, "viewer.tick === 1")
    tab.close()


@pytest.mark.full
@needs_browser
def test_two_replays_in_step_show_it_together(gl_browser: Any, replay_file: Path, tmp_path: Path) -> None:
    sides = [InStepSide(name, "", "runs/x", 60.0, replay_file.read_text("utf-8")) for name in "AB"]
    path = tmp_path / "step.html"
    path.write_text(render_in_step("crossing-4", "", sides, None, None), encoding="utf-8")
    for tab in open_quietly(gl_browser, path.as_uri()):
        wait_until(tab, "player.ready.length === 2")
        tab.keyboard.press("d")
        for frame in tab.frames[1:]:
            wait_until(frame, "viewer.space.drawn !== undefined")
        tab.keyboard.press("e")
        for frame in tab.frames[1:]:
            wait_until(frame, "viewer.space.view.pose.mode === 'driver'")
        tab.frames[2].locator("#view-mode").click()
        for frame in tab.frames[1:]:
            wait_until(frame, "viewer.space.view.pose.mode === 'mirrors'")
