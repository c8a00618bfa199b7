"""Sketches of scenarios are small, complete and nothing but numbers; terms of a page are those of the glossary."""

import re
import xml.etree.ElementTree as ET

import pytest
from testing.paths import ROOT

from mdrive_sumo.report.run_page.run_page import SCORE_TERMS
from mdrive_sumo.report.run_page.scenario_sketch import draw_scenario_sketch
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite


@pytest.mark.parametrize(
    ("suite", "index"), [("interdrive@0", 0), ("interdrive@0", 37), ("interaction@0", 60), ("v2xpnp@0", 3)]
)
def test_a_sketch_shows_every_cav_in_a_few_kilobytes(suite: str, index: int) -> None:
    packaged = load_suite(suite)
    scenario = packaged.scenarios[index]
    folder = find_network_folder(scenario.network, packaged.find_folder(scenario.id))
    text = draw_scenario_sketch(scenario, load_road_map(folder))
    image = ET.fromstring(text)
    assert len(image.findall(".//circle")) == len(scenario.egos)
    assert len(image.findall("g[@class='lanes']/path")) > 2
    assert len(text) < 12_000
    assert re.findall(r'="[^"]*nan', text) == []
    width, height = map(float, image.attrib["viewBox"].split()[2:])
    for dot in image.iter("circle"):
        assert 0 <= float(dot.attrib["cx"]) <= width and 0 <= float(dot.attrib["cy"]) <= height


def test_terms_have_the_words_of_the_glossary() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    rows = dict(re.findall(r"^\| ([^|]+?) \| (.+?) \|$", page, re.MULTILINE))
    assert {term: rows.get(term) for term in SCORE_TERMS} == dict(SCORE_TERMS)


def test_the_glossary_explains_a_term_once() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    terms = [part for row in re.findall(r"^\| ([^|]+?) \| ", page, re.MULTILINE) for part in row.split(", ")]
    repeated = {term for term in terms if terms.count(term) > 1 and not set(term) <= set("-: ")}
    assert repeated <= {"Term", "term"}
