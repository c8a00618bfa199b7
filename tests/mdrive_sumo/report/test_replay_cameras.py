"""Camera images of a replay page: what the page carries, and that they follow the time and the selected CAV."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.chromium import CHROMIUM
from testing.viewer_crossing import crossing, record, scenario

from mdrive_sumo.episode.camera_archive import CameraTrack, encode_image
from mdrive_sumo.report import replay_data
from mdrive_sumo.report.replay_page import render_replay

HOSTILE = "</script><script>window.owned = 1</script>"


def make_tracks(camera: str = "front") -> list[CameraTrack]:
    images = {tick: encode_image(np.full((24, 40, 3), tick, dtype=np.uint8)) for tick in (0, 4, 8, 200)}
    first, second = record().ego_ids
    return [
        CameraTrack(first, camera, images),
        CameraTrack(second, "rear", {6: images[4]}),
        CameraTrack("ghost", "x", images),
    ]


def read_images(page: str) -> Any:
    found = re.search(r'<script type="application/json" id="camera-images">(.*?)</script>', page, re.DOTALL)
    return json.loads(found[1]) if found else None


@pytest.mark.slow
def test_a_page_carries_the_images_of_its_cavs_within_the_episode() -> None:
    page = render_replay(record(), scenario(2), crossing(), (), None, make_tracks(HOSTILE))
    first, second = read_images(page)
    assert [one["tick"] for one in first["images"]] == [0, 4, 8]
    assert (first["ego"], first["camera"], second["ego"], second["camera"]) == (0, HOSTILE, 1, "rear")
    assert page.lower().count("</script>") == 5


@pytest.mark.slow
def test_without_images_a_page_has_no_card_for_them() -> None:
    page = render_replay(record(), scenario(2), crossing(), ())
    assert 'id="cameras"' not in page and read_images(page) is None


@pytest.mark.slow
def test_of_too_many_images_every_second_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    size = sum(len(image) for track in make_tracks()[:2] for image in track.images.values())
    monkeypatch.setattr(replay_data, "MAX_PAGE_BYTES", size // 2 + 1)
    first, _ = read_images(render_replay(record(), scenario(2), crossing(), (), None, make_tracks()))
    assert [one["tick"] for one in first["images"]] == [0, 8]


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.slow
def test_images_follow_the_time_and_the_selected_cav(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "replay.html"
    path.write_text(render_replay(record(), scenario(2), crossing(), (), None, make_tracks()), encoding="utf-8")
    tab = browser.new_page()
    trouble: list[str] = []
    tab.on("console", lambda message: trouble.append(message.text))
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    tab.goto(path.as_uri())
    tab.wait_for_selector("#cameras-list .camera:not([hidden])")
    figures = "[...document.querySelectorAll('.camera:not([hidden])')]"
    shown = f"{figures}.map((one) => [one.innerText, one.firstChild.src.slice(23)])"
    drawn = "new Promise((tell) => requestAnimationFrame(() => requestAnimationFrame(tell)))"
    first, second = read_images(path.read_text("utf-8"))
    for tick, number in ((0, 0), (3, 0), (4, 1), (30, 2)):
        tab.evaluate(f"viewer.seek({tick})")
        tab.evaluate(drawn)
        assert tab.evaluate(shown) == [["front", first["images"][number]["jpeg"]]]
    tab.click(".cav:nth-child(2) .choose")
    tab.evaluate(drawn)
    assert tab.evaluate(shown) == [["rear", second["images"][0]["jpeg"]]]
    tab.keyboard.press("c")
    assert not tab.is_visible("#cameras-list")
    tab.close()
    assert not trouble
