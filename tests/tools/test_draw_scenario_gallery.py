"""The gallery of the documentation shows every packaged scenario as it is."""

from pathlib import Path

from PIL import Image

from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite
from tools.draw_scenario_gallery import DOCS, PAGE, PICTURES, SIDE_PX, SUITE, draw_thumbnail, format_page


def test_the_page_lists_every_scenario_and_has_its_picture() -> None:
    """After a change of a suite: `python -m tools.draw_scenario_gallery`."""
    scenarios = load_suite(SUITE).scenarios
    assert (DOCS / PAGE).read_text("utf-8") == format_page(scenarios)
    assert {path.stem for path in (DOCS / PICTURES).iterdir()} == {scenario.id for scenario in scenarios}


def test_a_thumbnail_is_small_and_keeps_the_colours_of_cavs(tmp_path: Path) -> None:
    scenario = next(one for one in load_suite("interdrive@0") if one.id == "i07_ins_ss_town")
    draw_thumbnail(scenario, load_road_map(find_network_folder(scenario.network)), tmp_path / "a.webp")
    with Image.open(tmp_path / "a.webp") as image:
        assert max(image.size) == SIDE_PX
        saturation = image.convert("HSV").getchannel("S").getextrema()
    assert isinstance(saturation[1], int) and saturation[1] > 150
