"""The report page of a conversion: complete, true to its findings, small, and safe whatever text a log contains."""

import pickle
import re
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from testing.html_page import Page
from testing.report_findings import DT, HOSTILE, findings_of, log_of, small_findings, track

from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.html import PAGE
from real2sim.fidelity_report.index_page import build_index_row, write_index
from real2sim.fidelity_report.map_figures import compute_deviation
from real2sim.fidelity_report.report_page import render_report, write_report
from real2sim.readers.scenarionet import read_scenarionet

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> ConversionFindings:
    return small_findings(tmp_path_factory.mktemp("findings"))


@pytest.fixture(scope="module")
def html(found: ConversionFindings) -> str:
    return render_report(found)


def card(html: str, name: str) -> str:
    """Markup of the card of the thing whose id contains a word."""
    cards = re.split(r'(?=<details class="card")', html)
    (one,) = [card for card in cards[1:] if name in card.split("</summary>")[0]]
    return one


# ---- what it tells


def test_every_thing_has_a_row_and_a_card_and_failures_come_first_and_open(html: str) -> None:
    page = Page(html)
    cards = [one for one in page.all("details") if one.get("class") == "card"]
    assert len(cards) == 5
    assert ["open" in one for one in cards] == [True, False, False, False, False]
    assert card(html, "fast") in html
    assert "No. 1</b>" in card(html, "fast")
    assert [one["href"] for one in page.all("a") if one.get("href", "").startswith("#actor-")].count("#actor-5") >= 2  # type: ignore[union-attr]


def test_a_failure_says_its_figure_and_its_limit(html: str) -> None:
    assert "highest speed: 36.0 m/s (at most 30 m/s)" in card(html, ">fast<")
    assert "highest speed" not in card(html, ">cav<")


def test_a_card_says_what_cleaning_did_and_what_it_became(html: str) -> None:
    assert "teleport, 3 frames: 2.10 m to the side" in card(html, ">fast<")
    assert "it leaves the road" in card(html, ">fast<")
    assert "changed nothing" in card(html, ">cav<")


def tile(html: str, name: str) -> tuple[str, str]:
    """Class and value of a tile."""
    found = re.search(rf'<li class="(\w+)"><strong>([^<]*)</strong><span>{name}</span>', html)
    assert found is not None
    return found[1], found[2]


def test_tiles_say_what_misses_its_target(found: ConversionFindings, html: str) -> None:
    assert tile(html, "moving vehicles passing all checks") == ("missed", "2 of 3")
    assert tile(html, "order kept at conflicts") == ("missed", "17 of 20")
    assert tile(html, "traffic off the log at 5 s, median") == ("met", "1.00 m")
    assert tile(html, "teleports over 1 m") == ("met", "0")
    unknown = replace(found, quality=found.quality.model_copy(update={"error_median": None}))
    assert tile(render_report(unknown), "error median") == ("open", "–")


def test_the_head_says_what_is_missed(found: ConversionFindings, html: str) -> None:
    assert "Misses 2 targets." in html
    passed = found.quality.model_copy(update={"moving_passed_share": 1.0})
    told = render_report(replace(found, quality=passed))
    assert "Misses 1 target." in told
    assert "order kept at conflicts: 85.0 %, at least 90.0 % wanted" in told
    assert "Faithful." in render_report(replace(found, quality=passed, closeness=None))


def test_no_conflicts_are_not_a_kept_order(found: ConversionFindings) -> None:
    assert found.closeness is not None
    update = {"order_pairs": 0, "order_kept": 0, "order_share": None, "order_changed": ()}
    html = render_report(replace(found, closeness=found.closeness.model_copy(update=update)))
    assert tile(html, "order kept at conflicts") == ("open", "–")
    assert "No two of them share a conflict point." in html


def test_traffic_is_told_by_number_whatever_the_scenario_calls_it(found: ConversionFindings, html: str) -> None:
    section = html.split('id="traffic"')[1].split("<section")[0]
    number = re.search(r"No\. (\d)</b>", card(html, "&lt;script"))
    assert number is not None
    assert f'href="#actor-{number[1]}"' in section
    assert "plain-name" not in section
    assert "Not measured." in render_report(replace(found, closeness=None))


def test_a_scenario_without_anything_has_a_page(found: ConversionFindings) -> None:
    empty = found.quality.model_copy(update={"actors": (), "moving_vehicles": 0, "error_median": None})
    bare = replace(found, quality=empty, tracks=(), cleaned=replace(found.cleaned, tracks=(), cavs={}), closeness=None)
    assert "–" in Page(render_report(bare)).text


def drawn(html: str, id_: str) -> np.ndarray:
    """Points (N, 2) [cm] of a path of the definitions, dots as well."""
    d = Page(html).by_id(id_)["d"]
    assert d is not None
    numbers = np.array([int(n) for n in re.findall(r"-?\d+", re.sub(r"h0", "", d))])
    return np.cumsum(numbers.reshape(-1, 2), axis=0)


def test_tracks_are_drawn_where_they_are(found: ConversionFindings, html: str) -> None:
    number = int(re.search(r"No\. (\d)</b>", card(html, ">cav<"))[1])  # type: ignore[index]
    cav = next(one for one in found.tracks if one.id == "cav")
    raw = next(one for one in found.cleaned.tracks if one.id == "cav")
    for id_, line in ((f"way-{number}", cav), (f"raw-{number}", raw)):
        points = drawn(html, id_)
        assert len(points) == 60
        assert np.abs(np.diff(points[:, 0]) - 100 * np.diff(line.x)).max() <= 1.01
    both = drawn(html, f"way-{number}") - drawn(html, f"raw-{number}")
    fast = drawn(html, "way-1")
    assert 330 < fast[0, 1] - drawn(html, f"way-{number}")[0, 1] < 370  # it drives 3.5 m to the right: further down
    assert np.abs(both).max() <= 100 * np.hypot(cav.x - raw.x, cav.y - raw.y).max() + 1


def test_the_network_off_its_source_is_marked(found: ConversionFindings) -> None:
    assert compute_deviation(found).distance.max() < 0.2
    hd_map = found.recording.map
    west = hd_map.lanes["west"]
    moved = replace(hd_map, lanes={**hd_map.lanes, "west": replace(west, centre=west.centre + np.array((0.0, 0.5)))})
    off = replace(found, recording=replace(found.recording, map=moved))
    far = compute_deviation(off)
    assert 150 < (far.distance > 0.2).sum() < 250  # metres of a lane of 200 m
    assert np.allclose(far.xy[far.distance > 0.2][:, 1], 0.5)
    marks = re.search(r'<path d="([^"]*)" class="far"', render_report(off))
    assert marks is not None
    assert marks[1].count("h0") == (far.distance > 0.2).sum()
    assert '<path d="" class="far"' in render_report(found)


def hrefs(page: Page) -> list[str]:
    return [str(a["href"]) for _, a in page.tags if a.get("href") is not None]


def test_no_text_of_a_log_becomes_markup(html: str) -> None:
    page = Page(html)
    assert page.all("script") == page.all("img") == []
    assert not [name for _, attributes in page.tags for name in attributes if name.startswith("on") or name == "src"]
    assert page.text.count(HOSTILE) >= 6  # title, heading, table, card, change, role, note, traffic


def test_it_needs_nothing_but_itself(html: str) -> None:
    page = Page(html)
    inside = [href for href in hrefs(page) if href.startswith("#")]
    assert set(hrefs(page)) - set(inside) == {"data:,", f"../{PAGE}"}
    ids = [str(attributes["id"]) for _, attributes in page.tags if attributes.get("id")]
    assert len(ids) == len(set(ids))
    assert {href[1:] for href in inside} <= set(ids)
    assert "url(" not in html
    assert "@import" not in html
    assert not [attributes for _, attributes in page.tags if "style" in attributes]  # its policy forbids them


def test_every_picture_has_words_and_every_input_a_label(html: str) -> None:
    page = Page(html)
    pictures = page.all("svg")
    assert len(pictures) > 8
    assert all(one.get("aria-hidden") == "true" or (one["role"] == "img" and one["aria-label"]) for one in pictures)
    assert html.count("<label><input") == len(page.all("input")) > 0
    assert page.all("html")[0]["lang"] == "en"


def test_the_same_findings_give_the_same_bytes(found: ConversionFindings, html: str, tmp_path: Path) -> None:
    assert write_report(tmp_path, found) == tmp_path / PAGE
    assert (tmp_path / PAGE).read_text("utf-8") == html


def test_the_page_stays_small(tmp_path: Path) -> None:
    """40 restless vehicles for 10 s; a busy log has 85."""
    rng = np.random.default_rng(0)
    t = np.arange(100) * DT
    tracks = tuple(
        track(f"{k:036d}", 11 * t + 9 * k + rng.normal(0, 0.1, 100), rng.normal(0, 0.1, 100)) for k in range(40)
    )
    found = findings_of(log_of(tracks), tmp_path)
    assert len(found.tracks) > 28
    assert len(render_report(found).encode()) < 950_000


@pytest.mark.full
def test_a_real_log_has_a_page(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "real_logs" / "scenarionet_nuscenes" / "sd_nuscenes_v1.0-mini_scene-0103.pkl"
    found = findings_of(read_scenarionet(log), tmp_path)
    html = render_report(found)
    assert html.count('<details class="card"') == len(found.quality.actors) > 100
    assert len(html.encode()) < 1_500_000
    assert Page(html).all("script") == []


# ---- the index


def test_the_index_lists_what_misses_first_and_links_every_page(found: ConversionFindings, tmp_path: Path) -> None:
    line = build_index_row(found)
    assert (line.passed, line.moving, line.median_at_5s, line.order_share) == (2, 3, 1.0, 0.85)
    good = replace(line, id="aa-good", misses=())
    path = write_index(tmp_path, f"suite {HOSTILE}", [good, replace(line, id="zz-bad"), replace(line, id=HOSTILE)])
    page = Page(path.read_text("utf-8"))
    assert page.all("script") == page.all("img") == []
    links = [href for href in hrefs(page) if href.endswith(PAGE)]
    assert links == [f"{quote(HOSTILE, safe='')}/{PAGE}", f"zz-bad/{PAGE}", f"aa-good/{PAGE}"]
    assert "1 of 3 scenarios meet every target." in page.text
    pictures = [one for one in page.all("svg") if one["class"] == "thumbnail"]
    assert len(pictures) == 3
    assert len({one["class"] for one in page.all("path") if one["class"] != "asphalt"}) == 4  # of every verdict
    assert len(pickle.dumps(line)) < 20_000
    assert pickle.loads(pickle.dumps(line)) == line
    assert "6 of 9 moving vehicles (66.7 %)" in page.text
