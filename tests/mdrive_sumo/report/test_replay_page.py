"""The replay viewer: what the page carries, that nothing breaks out of it, and how it works in a browser."""

import base64
import gzip
import json
import re
import statistics
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from testing.chromium import CHROMIUM
from testing.viewer_crossing import crossing, ego_state, record, scenario, some_marks

from mdrive_sumo.contract import Cause, Reason
from mdrive_sumo.episode import EpisodeRecord, NoteRecord
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.roads.drawing.map_geometry import build_map_geometry
from mdrive_sumo.scenario.scenario import Scenario

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]

HOSTILE = '</script><script>document.title="owned"</script><img src=x onerror=alert(1)>'


TICKS = 300


@pytest.fixture(scope="module")
def long_episode() -> EpisodeRecord:
    return record(ticks=TICKS, egos=4, actors=100)


def carried(page: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and tables of a page, read independently of the page's own script."""
    found = re.search(r'id="data">([A-Za-z0-9+/=]+)</script>', page)
    assert found
    packed = gzip.decompress(base64.b64decode(found[1]))
    size = int.from_bytes(packed[:4], "little")
    header, offset, tables = json.loads(packed[4 : 4 + size]), 4 + size, {}
    for name, columns, count in header["tables"]:
        steps = np.frombuffer(packed, "<i4", count, offset).reshape(count // max(columns, 1), columns)
        tables[name], offset = np.cumsum(steps, axis=1), offset + 4 * count
    assert offset == len(packed)
    return header, tables


def test_the_page_carries_the_episode() -> None:
    episode = record()
    header, tables = carried(render_replay(episode, scenario(2), crossing(), some_marks(40)))
    motion = tables["motion"].reshape(len(episode.ids), 4, episode.ticks)
    x = np.where(episode.valid.T, motion[:, 0] / 1000 + header["origin"][0], 0.0)
    assert np.allclose(x, episode.x.T, atol=1e-9)
    assert np.array_equal(motion[:, 3].T * episode.valid, episode.quanta[..., 3])
    assert np.array_equal(tables["valid"].T, episode.valid)
    assert np.array_equal(tables["controls"].reshape(2, 3, -1), np.moveaxis(episode.controls, 0, -1))
    assert header["ids"] == list(episode.ids)
    assert header["endings"][1] == [1, 28, "agent-failed", "crashed"]
    first = tables["plan_points"][:, 0] / 100 + header["origin"]
    assert np.allclose(first, episode.plans[0].points[0])


def test_only_roads_near_something_are_carried() -> None:
    """The crossing has another lane 5 km away."""
    header, _ = carried(render_replay(record(), scenario(2), crossing(), ()))
    carried_map = header["map"]
    counts = {kind: len(carried_map[kind]) for kind in ("asphalt", "pavements", "buildings", "stops", "heads")}
    assert counts == {"asphalt": 1, "pavements": 1, "buildings": 1, "stops": 1, "heads": 8}
    assert len(carried_map["stripes"]) > 10 and len(carried_map["dashed"]) == 8
    numbers = [number for shape in carried_map["asphalt"] for ring in shape for number in ring]
    assert max(map(abs, numbers)) < 60_000


def test_plots_and_replay_show_one_geometry() -> None:
    header, _ = carried(render_replay(record(), scenario(2), crossing(), ()))
    geometry = build_map_geometry(crossing(), shapely.box(-300, -300, 300, 300))
    shift = header["origin"]
    for kind, lines in (("solid", geometry.markings.solid), ("dashed", geometry.markings.dashed)):
        shown = [np.reshape(flat, (-1, 2)) / 100 + shift for flat in header["map"][kind]]
        assert len(shown) == len(lines)
        assert all(np.allclose(one, other, atol=0.006) for one, other in zip(shown, lines, strict=True))
    rings = (np.reshape(shape[0], (-1, 2)) / 100 + shift for shape in header["map"]["asphalt"])
    assert sum(map(shapely.area, map(shapely.Polygon, rings))) == pytest.approx(
        shapely.union_all(geometry.asphalt).area, rel=1e-3
    )


def test_far_from_the_origin_numbers_stay_small() -> None:
    """Canvas paths are single precision: at 800 km they would be off by centimetres."""
    away = scenario(2).model_dump()
    away["egos"][0]["route"] = [(x + 8e5, y - 8e5, yaw) for x, y, yaw in away["egos"][0]["route"]]
    away["egos"][0]["start"]["x"] += 8e5
    away["egos"][0]["start"]["y"] -= 8e5
    header, _ = carried(render_replay(record(), Scenario.model_validate(away), crossing(), ()))
    assert header["origin"] == [8e5 - 100, -8e5 - 5] and abs(header["routes"][0][0]) < 100


def test_hostile_texts_stay_data() -> None:
    episode = record(prefix=HOSTILE, text=HOSTILE)
    page = render_replay(episode, scenario(2), crossing(), some_marks(40, HOSTILE))
    assert "owned" not in page and "onerror" not in page
    assert carried(page)[0]["marks"][0][3] == HOSTILE
    assert page.lower().count("</script>") == 4, "data, scene, and the scripts of the page and of its 3-D view"


def test_the_page_is_self_contained_and_the_same_every_time() -> None:
    pages = [render_replay(record(), scenario(2), crossing(), some_marks(40)) for _ in range(2)]
    assert pages[0] == pages[1]
    reaching_out = r"https?:|//[a-z]+\.|@import|url\(|<link(?! rel=\"icon\" href=\"data:,\")|\bsrc=|\bimport\b"
    assert not re.findall(reaching_out, pages[0])
    assert "default-src 'none'" in pages[0]


def test_the_page_stays_small(long_episode: EpisodeRecord) -> None:
    """100 road users for 60 s must be a file that can be mailed, however restless they are: here a quarter of it."""
    restless = np.random.default_rng(1).integers(-300, 300, long_episode.quanta.shape, dtype=np.int32)
    noisy = replace(long_episode, quanta=long_episode.quanta + restless)
    assert len(render_replay(noisy, scenario(4), crossing(), ())) < 750_000


# ---- in a browser

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


@pytest.fixture(scope="module")
def replay_file(tmp_path_factory: pytest.TempPathFactory, long_episode: EpisodeRecord) -> Path:
    path = tmp_path_factory.mktemp("view") / "replay.html"
    path.write_text(render_replay(long_episode, scenario(4), crossing(), some_marks(TICKS)), encoding="utf-8")
    return path


@pytest.fixture
def page(browser: Any, replay_file: Path) -> Iterator[Any]:
    """The replay in a fresh tab; at the end, nothing may have been fetched or complained about."""
    yield from opened(browser, replay_file.as_uri())


def opened(browser: Any, address: str, size: tuple[int, int] = (1280, 720)) -> Iterator[Any]:
    tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
    trouble: list[str] = []
    tab.on("console", lambda message: trouble.append(message.text))
    tab.on("pageerror", lambda error: trouble.append(str(error)))
    requests: list[str] = []
    tab.on("request", lambda request: requests.append(request.url.split("#")[0]))
    tab.goto(address)
    wait(tab, "window.viewer && viewer.drawTimes.length > 0")
    yield tab
    tab.close()
    assert not trouble
    assert requests == [address.split("#")[0]]


def wait(tab: Any, truth: str) -> None:
    """Until the expression is true. Playwright's own waiting needs eval, which the page's policy forbids."""
    end = time.monotonic() + 60.0
    while not tab.evaluate(truth):
        assert time.monotonic() < end, f"never true: {truth}"
        tab.wait_for_timeout(25)


SETTLED = """new Promise((tell) => {
    const last = viewer.frameTimes.at(-1);
    requestAnimationFrame(() => requestAnimationFrame(() => tell(viewer.frameTimes.at(-1) === last)));
})"""
"""Nothing is left to be drawn: the browser has made two frames, and the page none."""


@needs_browser
def test_it_plays_and_pauses(page: Any) -> None:
    assert page.evaluate("[viewer.tick, viewer.ticks, viewer.playing]") == [0, TICKS, False]
    page.keyboard.press("Space")
    wait(page, "viewer.tick > 5")
    page.click("#play")
    assert not page.evaluate("viewer.playing")
    stopped = page.evaluate("viewer.tick")
    page.wait_for_timeout(100)
    assert page.evaluate("viewer.tick") == stopped


@needs_browser
def test_keys_step_by_tick_and_second(page: Any) -> None:
    steps = {"ArrowRight": 1, "Shift+ArrowRight": 21, "ArrowLeft": 20, "End": TICKS - 1, "Home": 0}
    for key, tick in steps.items():
        page.keyboard.press(key)
        assert page.evaluate("viewer.tick") == tick, key


@needs_browser
def test_marks_events_and_track_jump(page: Any) -> None:
    page.click(".mark.bad >> nth=0")
    assert page.evaluate("viewer.tick") == TICKS // 2
    assert "hit cav_1" in page.inner_text("#tip")
    assert page.inner_text(".event >> nth=0").split("\n")[-1] == "cav_1 · x 0.80"  # kind once
    page.click(".event >> nth=0")
    assert page.evaluate("viewer.tick") == TICKS // 4
    page.keyboard.press("n")
    assert page.evaluate("viewer.tick") == TICKS // 2
    box = page.locator("#track").bounding_box()
    page.mouse.click(box["x"] + box["width"] * 0.9, box["y"] + box["height"] - 10)
    assert abs(page.evaluate("viewer.tick") - 0.9 * TICKS) <= 2
    wait(page, "document.getElementById('cavs').innerText.includes('agent-failed at 10.5 s')")


@needs_browser
def test_follow_keeps_the_cav_in_the_middle(page: Any) -> None:
    page.keyboard.press("f")
    page.keyboard.press("f")
    page.evaluate("viewer.seek(150)")
    wait(page, SETTLED)
    seen = page.evaluate("({follow: viewer.followed, ...viewer.view})")
    truth = ego_state(1, 150)
    assert seen["follow"] == 1
    assert (seen["x"], seen["y"]) == pytest.approx((truth.x + 100, truth.y + 5), abs=0.01)  # the page's origin
    page.mouse.move(300, 200)
    page.mouse.down()
    page.mouse.move(400, 240)
    page.mouse.up()
    assert page.evaluate("viewer.followed") == -1  # dragging lets go


@needs_browser
def test_the_wheel_zooms_at_the_pointer(page: Any) -> None:
    page.mouse.move(420, 150)
    before = page.inner_text("#pointer")
    scale = page.evaluate("viewer.view.scale")
    page.mouse.wheel(0, -400)
    wait(page, f"viewer.view.scale > {scale * 1.5}")
    page.mouse.move(421, 150)
    page.mouse.move(420, 150)
    then, now = ([float(n) for n in re.findall(r"-?\d+\.\d", text)] for text in (before, page.inner_text("#pointer")))
    assert then == pytest.approx(now, abs=0.5)
    page.keyboard.press("0")
    wait(page, f"Math.abs(viewer.view.scale - {scale}) < 1e-9")


@needs_browser
def test_what_the_page_unpacks(browser: Any, tmp_path: Path) -> None:
    path, episode = tmp_path / "short.html", record()
    path.write_text(render_replay(episode, scenario(2), crossing(), ()), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        tab.evaluate("window.pose = {}; viewer.replay.sample(0, 10.5, pose)")
        between = (
            (episode.x[10, 0] + episode.x[11, 0]) / 2 - -100.0,
            (episode.y[10, 0] + episode.y[11, 0]) / 2 - -5.0,
        )
        assert tab.evaluate("[pose.x, pose.y]") == pytest.approx(between, abs=1e-3)
        assert tab.evaluate("viewer.replay.sample(1, 28, {})") is False  # its agent failed in tick 28
        assert tab.evaluate("[19, 20].map((tick) => viewer.replay.signalAt('c:0', tick))") == ["r", "G"]
        ages = tab.evaluate("[24, 34, 35].map((tick) => viewer.replay.planAt(1, tick).length)")
        assert ages == [8, 8, 0]  # the last plan of tick 24 is shown for half a second
        assert len(tab.evaluate("viewer.replay.contactsWithin(20, 20)")) == 1


@needs_browser
def test_each_cav_says_why_it_drives_as_it_does(browser: Any, tmp_path: Path) -> None:
    reasons = {5: Reason(Cause.FREE, speed=8.0), 20: Reason(Cause.YIELD, ("00c0ffee",), seconds=2.1)}
    notes = tuple(NoteRecord(tick, "cav_0", reason.to_note()) for tick, reason in reasons.items())
    episode = replace(record(), notes=notes, pseudonyms={"00c0ffee": "cav_1"})
    path = tmp_path / "replay.html"
    path.write_text(render_replay(episode, scenario(2), crossing(), ()), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        said = {}
        for tick in (4, 19, 20, 39):
            tab.evaluate(f"viewer.seek({tick})")
            wait(tab, SETTLED)
            said[tick] = tab.inner_text(".state >> nth=0")
        assert said.pop(39).startswith("arrived")
        assert said.pop(20) == "yields to CAV cav_1, which crosses in 2.1 s"
        assert said == {4: "driving", 19: "drives freely, at up to 8.0 m/s"}
        assert "yields to CAV cav_1" in tab.locator("#transcript .entry >> nth=1").text_content()


@needs_browser
def test_a_link_opens_at_its_time(browser: Any, replay_file: Path) -> None:
    for tab in opened(browser, f"{replay_file.as_uri()}#t=6.4"):
        assert tab.evaluate("viewer.tick") == 128
        tab.keyboard.press("ArrowRight")
        wait(tab, "location.hash === '#t=6.45'")


@needs_browser
def test_hostile_texts_do_nothing_in_a_browser(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "hostile.html"
    episode = record(prefix=HOSTILE, text=HOSTILE)
    path.write_text(render_replay(episode, scenario(2), crossing(), some_marks(40, HOSTILE)), encoding="utf-8")
    for tab in opened(browser, path.as_uri()):
        tab.evaluate("viewer.seek(20)")
        tab.hover(".mark.bad >> nth=0")
        assert tab.title() == "crossing-4 · mdrive-sumo"
        assert tab.evaluate("document.images.length") == 0
        assert HOSTILE in tab.inner_text("#events")


@needs_browser
def test_a_hundred_actors_draw_fast_enough(page: Any, record_property: Any) -> None:
    """60 frames/s leave 16.7 ms, and drawing took 1.2 of them when written; the limit is for machines that are busy."""
    page.keyboard.press("l")  # all labels
    page.keyboard.press("Space")
    wait(page, "viewer.drawTimes.length >= 60")
    frames, draws = page.evaluate("[viewer.frameTimes, viewer.drawTimes]")
    record_property("frame_interval_p50_ms", float(np.median(np.diff(frames[-50:]))))
    record_property("draw_p50_ms", float(np.median(draws[-50:])))
    assert statistics.median(draws[-50:]) <= 40.0
