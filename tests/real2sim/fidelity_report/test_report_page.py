"""The report page of a conversion: complete, true to its findings, small, and safe whatever a log calls its things."""

import pickle
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from testing.paths import ROOT
from testing.report_findings import DT, HOSTILE, findings_of, log_of, small_findings, track

from real2sim.clean.cleaning_report import ChangeReason
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import CLEANING_ACTIONS, FIGURES, describe_failures, describe_figure
from real2sim.fidelity_report.index_page import build_index_row, render_index, write_index
from real2sim.fidelity_report.line_chart import ChartSeries, LineChart, draw_chart
from real2sim.fidelity_report.network_section import compute_deviation
from real2sim.fidelity_report.report_page import PAGE, render_report, write_report
from real2sim.quality import CHECKS
from real2sim.quality.actor_quality import ActorQuality
from real2sim.readers.scenarionet import read_scenarionet


class Page(HTMLParser):
    """All elements of a page with their text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    def all(self, name: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.tags if tag == name]

    def by_id(self, id_: str) -> dict[str, str | None]:
        (found,) = [attributes for _, attributes in self.tags if attributes.get("id") == id_]
        return found

    @property
    def text(self) -> str:
        return " ".join(self.words)


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


def test_the_head_says_what_the_pipeline_says_is_missed(found: ConversionFindings, html: str) -> None:
    assert "Misses 2 targets." in html
    told = render_report(replace(found, misses=("the only one",)))
    assert "Misses 1 target." in told
    assert "the only one" in told
    passed = found.quality.model_copy(update={"moving_passed_share": 1.0})
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


def test_every_check_and_every_reason_has_words() -> None:
    assert {check.figure for check in CHECKS} <= set(FIGURES)
    assert set(CLEANING_ACTIONS) == set(ChangeReason)
    assert set(FIGURES) <= set(ActorQuality.model_fields)


def test_a_figure_just_over_its_limit_does_not_read_as_if_it_were_met() -> None:
    limit = next(check.limit for check in CHECKS if check.figure == "error_p95")
    actor = ActorQuality(
        id="a", category="car", moving=True, frames=9, gaps=0, error_p95=limit + 0.0004, failed=("error_p95",)
    )
    assert f"{limit + 0.0004:.4f} m (at most {limit:g} m)" in describe_failures(actor)[0]


# ---- what it shows


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


def test_a_chart_cuts_off_what_is_too_high_and_breaks_at_gaps() -> None:
    y = np.array([0.0, 1.0, np.nan, 50.0, 1.0])
    svg = draw_chart(LineChart("words", "title", [ChartSeries("line", np.arange(5.0), y)], (0.0, 4.0), 2.0, (1.5, 9.0)))
    (line,) = [part for part in svg.split("<path ") if 'class="line"' in part]
    assert line.count("M") == 2
    assert svg.count('class="limit"') == 1
    (limit,) = [part for part in svg.split("<path ") if 'class="limit"' in part]
    assert limit.count("M") == 1  # the limit beyond the top is not drawn


# ---- how it is made


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
    """85 restless vehicles for 10 s."""
    rng = np.random.default_rng(0)
    t = np.arange(100) * DT
    tracks = tuple(
        track(f"{k:036d}", 11 * t + 9 * k + rng.normal(0, 0.1, 100), rng.normal(0, 0.1, 100)) for k in range(85)
    )
    found = findings_of(log_of(tracks), tmp_path)
    assert len(found.tracks) > 60
    assert len(render_report(found).encode()) < 2_000_000


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


def test_an_index_of_nothing_is_a_page() -> None:
    assert "0 of 0 scenarios" in Page(render_index("none", [])).text


# ---- colours


def colours(css: str) -> Mapping[str, tuple[float, ...]]:
    found = re.findall(r"--([\w-]+): #([0-9a-f]{6})", css)
    return {name: tuple(int(value[k : k + 2], 16) / 255 for k in (0, 2, 4)) for name, value in found}


def contrast(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    """WCAG 2.2, 1.4.3."""

    def luminance(colour: tuple[float, ...]) -> float:
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour)
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_can_be_read_and_lines_be_told_from_the_road(scheme: str) -> None:
    css = (ROOT / "real2sim" / "fidelity_report" / "static" / "report.css").read_text()
    light, dark = css.split("@media (prefers-color-scheme: dark)")
    colour = colours(light if scheme == "light" else dark.split("* {")[0])
    for ground in ("paper", "card", "stripe"):
        assert all(contrast(colour[ink], colour[ground]) >= 4.5 for ink in ("ink", "muted", "cav", "pass", "fail"))
    assert all(contrast(colour[look], colour[f"{look}-tint"]) >= 4.5 for look in ("pass", "fail", "cav"))
    for line in ("pass", "fail", "walk", "cav", "raw", "source"):
        assert contrast(colour[line], colour["road"]) >= 3.0
        assert contrast(colour[line], colour["card"]) >= 3.0


def test_the_document_names_every_check_with_its_limit_and_source() -> None:
    """Both can only be changed together: docs/real2sim.md is what a reader checks the figures against."""
    text = (ROOT / "docs" / "real2sim.md").read_text("utf-8")
    table = text.split("<!-- checks -->")[1].split("<!-- /checks -->")[0]
    assert table.strip().splitlines()[2:] == check_rows()


def check_rows() -> list[str]:
    """Markdown rows of all checks."""
    rows = ((describe_figure(check.figure), check) for check in CHECKS)
    return [
        f"| {words} | {check.limit:g}{f' {unit}' if unit else ''} | {check.source} |"
        for (words, unit, _), check in rows
    ]
