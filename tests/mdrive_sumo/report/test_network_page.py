"""The page of a network: it carries lanes safely, and clicks on its map become routes that the library reads."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from testing.chromium import CHROMIUM, open_quietly

from mdrive_sumo.cli import main
from mdrive_sumo.report.network_page import render_network_page
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.worlds.authoring.route_steps import build_route


@pytest.fixture(scope="module")
def roads() -> RoadMap:
    return load_road_map(find_network_folder("old_town"))


def carried(page: str) -> dict[str, Any]:
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def test_the_page_carries_every_lane_in_place(roads: RoadMap) -> None:
    data = carried(render_network_page(roads))
    assert [lane[0] for lane in data["lanes"]] == [lane.id for lane in roads.driving]
    _, flat, junction, width, speed = next(lane for lane in data["lanes"] if lane[0] == "south_in_1")
    lane = roads.lanes["south_in_1"]
    assert (flat[0] / 100 + data["origin"][0], flat[1] / 100 + data["origin"][1]) == pytest.approx(
        tuple(lane.centre.xy[0]), abs=0.01
    )
    assert (junction, width, speed) == (0, round(lane.width, 2), round(lane.speed_limit, 2))


def test_a_strangers_lane_id_stays_text(roads: RoadMap) -> None:
    hostile = "</script><script>document.title=1</script>"
    lane = replace(roads.lanes["south_in_1"], id=hostile)
    page = render_network_page(replace(roads, lanes={**roads.lanes, hostile: lane}, name="<b>x"))
    assert hostile not in page and "<b>x" not in page
    assert hostile in [one[0] for one in carried(page)["lanes"]]


def test_view_writes_the_page_of_a_folder_and_of_a_packaged_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for what, written in (("old_town", "old_town.html"), (str(find_network_folder("avenue")), "avenue.html")):
        done = CliRunner().invoke(main, ["view", what, "--no-open"])
        assert (done.exit_code, done.output.strip()) == (0, written), done.output
        assert (tmp_path / written).is_file()
    done = CliRunner().invoke(main, ["view", "old_tow", "--no-open"])
    assert done.exit_code == 2 and len(done.output.strip().splitlines()) == 1


@pytest.fixture
def tab(browser: Any, roads: RoadMap, tmp_path: Path) -> Iterator[Any]:
    (tmp_path / "page.html").write_text(render_network_page(roads))
    yield from open_quietly(browser, (tmp_path / "page.html").as_uri())


PLACE = """([lane, s]) => {
    const [x, y] = window.page.lanes.find((one) => one.id === lane).at(s);
    return window.page.view.toScreen(x, y).map((px) => px / devicePixelRatio);
}"""


@pytest.mark.slow
@pytest.mark.costly_fixture
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_clicks_become_a_route_that_the_library_reads(tab: Any, roads: RoadMap) -> None:
    for lane, s in (("south_in_1", 40.0), ("west_out_1", 30.0)):
        tab.mouse.click(*tab.evaluate(PLACE, [lane, s]))
    text = tab.input_value("#route")
    assert re.fullmatch(r"south_in_1 (39|40)\.\d > west_out_1 (29|30)\.\d", text)
    assert build_route(roads, text).lanes == ("south_in_1", ":x_5_0", "west_out_1")
    assert tab.locator("#steps li").count() == 2
    tab.click("#clear")
    tab.keyboard.down("Shift")
    tab.mouse.click(*tab.evaluate(PLACE, ["south_in_1", 40.0]))
    tab.keyboard.up("Shift")
    x, y = (float(number) for number in tab.input_value("#route").split(","))
    assert (x, y) == pytest.approx(roads.lanes["south_in_1"].centre.at(40.0), abs=0.5)
    tab.click("#undo")
    assert tab.input_value("#route") == ""
    tab.fill("#find", "west_in_1")
    tab.keyboard.press("Enter")
    assert tab.evaluate("window.page.view.scale") >= 4
