"""The replay's window: no CAV lies under a panel, panels fold, a phone shows map and events; scores and units."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.chromium import COVERED
from testing.viewer_crossing import crossing, record, scenario, some_marks

from mdrive_sumo.core.state import End
from mdrive_sumo.episode.camera_archive import CameraTrack, encode_image
from mdrive_sumo.report.palette import CAV_COLOURS
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.scoring import EgoResult, ScenarioResult
from tests.mdrive_sumo.report.test_replay_page import SETTLED, needs_browser, opened, wait

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
TICKS = 120


@pytest.fixture(scope="module")
def replay_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "replay.html"
    page = render_replay(record(TICKS, egos=4), scenario(4), crossing(), some_marks(TICKS))
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, replay_file: Path) -> Iterator[Any]:
    yield from opened(browser, replay_file.as_uri())


@needs_browser
@pytest.mark.parametrize("size", [(1440, 900), (1150, 720), (390, 844), (358, 675)])
def test_no_cav_is_hidden_behind_a_panel(page: Any, size: tuple[int, int]) -> None:
    """A desktop's window, its frame in the server's page, a phone's window and frame: also after a fold and a turn."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    wait(page, SETTLED)
    assert page.evaluate(COVERED) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    stage = "document.getElementById('stage').clientWidth * document.getElementById('stage').clientHeight"
    stage_px = page.evaluate(stage)
    for button in ("#layers-fold", "#panel-fold"):
        page.click(button)
        wait(page, SETTLED)
        assert page.evaluate(COVERED) == []
    assert page.evaluate(stage) > stage_px  # the panel is folded


@needs_browser
def test_camera_images_hide_no_cav(browser: Any, tmp_path: Path) -> None:
    """The card of images lies over the map: the scene is fitted beside or below it."""
    images = {tick: encode_image(np.full((120, 200, 3), 90, dtype=np.uint8)) for tick in (0, 40)}
    replay = record(TICKS, egos=4)
    tracks = [CameraTrack(ego, name, images) for ego in replay.ego_ids for name in ("front", "rear")]
    path = tmp_path / "cameras.html"
    path.write_text(render_replay(replay, scenario(4), crossing(), (), None, tracks), encoding="utf-8")
    for tab in opened(browser, path.as_uri(), (1440, 900)):
        tab.wait_for_selector("#cameras-list .camera:not([hidden])")
        wait(tab, SETTLED)
        assert tab.evaluate("document.getElementById('cameras').clientWidth") > 200
        assert tab.evaluate(COVERED) == []


@needs_browser
def test_a_phone_shows_map_and_events(browser: Any, replay_file: Path) -> None:
    for tab in opened(browser, replay_file.as_uri(), (390, 844)):
        assert tab.evaluate("document.getElementById('stage').clientHeight") > 300
        assert tab.evaluate("document.getElementById('layers').offsetHeight") < 50  # folded: the scene is not below it
        event = tab.locator(".event.bad").first
        box = event.bounding_box()
        assert box["y"] + box["height"] < 844 and box["height"] >= 40  # large enough for a finger
        event.click()
        assert tab.evaluate("viewer.tick") == TICKS // 2
        tab.click("#play")
        assert tab.evaluate("viewer.playing")


@needs_browser
def test_a_moved_view_stays_when_panels_fold(page: Any) -> None:
    page.keyboard.press("+")
    scale = page.evaluate("viewer.view.scale")
    page.keyboard.press("h")
    page.keyboard.press("y")
    wait(page, SETTLED)
    assert page.evaluate("viewer.view.scale") == scale
    assert page.get_attribute("#panel-fold", "aria-expanded") == "false"


@needs_browser
def test_scores_description_and_units_are_in_the_page(browser: Any, tmp_path: Path) -> None:
    path, told = tmp_path / "scored.html", scenario(2).model_copy(update={"description": "Two cars <b>cross</b>."})
    egos = [
        EgoResult(id=f"cav_{i}", outcome=End.ARRIVED, reason="", ds=60.0 - i, rc=100.0, ip=0.6, infractions=())
        for i in (0, 1)
    ]
    result = ScenarioResult(
        id="crossing-4", bucket="b", category="c", seed=0, status="ok", reason="", min_ttc=None, digest="", ticks=40,
        ds=59.5, sr=0.0, rc=100.0, ip=0.6, egos=tuple(egos),
    )  # fmt: skip
    path.write_text(render_replay(record(), told, crossing(), (), result), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        assert tab.inner_text("#description") == "Two cars <b>cross</b>."
        shown = tab.locator("#scores div").all_inner_texts()
        wanted = {"DS": f"{result.ds:.1f} %", "SR": f"{result.sr:.1f} %", "RC": f"{result.rc:.1f} %"}
        assert [text.split("\n") for text in shown] == [
            [*pair] for pair in (wanted | {"IP": f"{result.ip:.2f}"}).items()
        ]
        first = result.egos[0]
        assert f"DS {first.ds:.1f} % · RC {first.rc:.1f} % · IP {first.ip:.2f}" in tab.inner_text(".cav >> nth=0")
        assert re.search(r"Speed\s+7\.0 m/s\s+Pedals\s+\+\d+ %\s+Steer\s+\+\d+ %", tab.inner_text("#gutter"))
        colours = tab.evaluate("[...document.querySelectorAll('.cav .swatch')].map((e) => e.style.background)")
        assert [tuple(map(int, re.findall(r"\d+", colour))) for colour in colours] == [
            tuple(bytes.fromhex(colour[1:])) for colour in CAV_COLOURS[:2]
        ]
