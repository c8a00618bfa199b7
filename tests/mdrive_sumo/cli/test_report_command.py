"""`mdrive-sumo report` from folders of runs to files, and its page in a browser."""

import csv
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Page, sync_playwright
from testing.chromium import CHROMIUM, list_flags, wait_until
from testing.report_samples import BEST, make_agent_run, make_sample_runs, save_run, save_sample_runs
from testing.study_samples import invoke
from testing.view_runs import make_run

from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.comparison_report import build_comparison_report
from mdrive_sumo.report.comparison_report.write_comparison_report import format_report_markdown, render_report_page
from mdrive_sumo.report.run_page import replay_files
from mdrive_sumo.report.table_latex import format_latex
from mdrive_sumo.scoring import ScenarioResult

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
TABLES = {
    *("main", "buckets", "levels", "interdrive_groups", "categories_h", "categories_ds", "categories_sr"),
    *("differences", "differences_by_bucket", "outcomes", "infractions", "distribution", "cooperation", "efficiency"),
    *("scenarios_ds", "scenarios_sr", "provenance", "ranking"),
}
FIGURES = {"levels", "differences", "distribution", "scenarios"}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report over the sample runs, written by the command."""
    folder = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["mdrive-sumo", "report", "a_run_whose_name_is_wider_than_a_phone/" * 3])
        ended = invoke("report", *save_sample_runs(folder / "runs"), "--out", folder / "out")
    assert ended.exit_code == 0, ended.output
    assert "Privileged: an upper bound, not ranked:" in ended.output and "report.html" in ended.output
    return folder / "out"


def test_every_table_and_figure_has_its_files(out: Path) -> None:
    assert {path.stem for path in (out / "csv").iterdir()} == TABLES
    assert {path.stem for path in (out / "latex").iterdir()} == TABLES | {"all_tables"}
    figures = {f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")}
    assert {path.name for path in (out / "figures").iterdir()} == figures
    assert (out / "figures" / "levels.png").read_bytes().startswith(b"\x89PNG")
    with (out / "csv" / "main.csv").open(encoding="utf-8") as file:
        rows = {row["agent"]: row for row in csv.DictReader(file)}
    for name, folder in {"single": "single", "omniscient": "omniscient"}.items():
        overall = make_sample_runs()[folder].overall.bucket_mean
        assert float(rows[name]["overall_ds"]) == pytest.approx(overall.ds, abs=1e-6)
        assert float(rows[name]["overall_sr"]) == pytest.approx(overall.sr, abs=1e-6)
    assert rows["single"]["interdrive_ds_low"] == "", "two scenarios are too few"


def test_markdown_shows_every_table_and_figure(out: Path) -> None:
    text = (out / "report.md").read_text("utf-8")
    assert len(re.findall(r"^### ", text, re.MULTILINE)) == len(TABLES)
    for path in re.findall(r"!\[[^]]*\]\(([^)]*)\)", text):
        assert (out / path).is_file()
    assert "mdrive-sumo" in text.partition("## Provenance")[2] and "- **Note:** The agents were driven under" in text


def test_figures_are_vectors_without_chance(out: Path) -> None:
    report = build_comparison_report(make_agents_of_results(make_sample_runs().values()))
    for figure in report.figures:
        written = (out / "figures" / f"{figure.name}.svg").read_bytes()
        assert b"<image" not in written and ET.fromstring(written).tag.endswith("svg")
    levels = report.figures[0]
    assert levels.render("svg")[0] == (out / "figures" / "levels.svg").read_bytes()
    assert "sharing (channel ideal): static-avoidance 100.0, dynamic-avoidance 61.5" in levels.description


class _PageParts(HTMLParser):
    """Collects ids, links and cells of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append(tag)
        self.ids += [found["id"] or ""] if "id" in found else []
        self.links += [found["href"] or ""] if tag == "a" else []


def test_the_page_is_self_contained(out: Path) -> None:
    text = (out / "report.html").read_text("utf-8")
    page = _PageParts(text)
    assert not {"script", "link", "iframe", "img"} & set(page.tags)
    assert len(set(page.ids)) == len(page.ids), "an id stands once"
    for link in page.links:
        assert link[1:] in page.ids if link.startswith("#") else (out / link).is_file(), link
    addresses = set(re.findall(r"https?://[^\s\"'<]+", text))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}, addresses
    assert set(re.findall(r"var\(--([a-z-]+)\)", text)) <= set(re.findall(r"--([a-z-]+):", text))


def test_names_of_agents_cannot_break_a_page() -> None:
    name = '<b>x</b> & "y" | \\z{} $\\frac{$ ](u)'
    report = build_comparison_report(make_agents_of_results([make_agent_run(name, BEST), make_agent_run("a", BEST)]))
    page = render_report_page(report, {figure.name: b"<svg></svg>" for figure in report.figures})
    assert "<b>" not in page and page.count("&lt;b&gt;x&lt;/b&gt;") > 10
    assert "<b>" not in format_report_markdown(report)
    assert report.figures[0].render("svg")[0].startswith(b"<?xml"), "a dollar sign begins no formula"
    assert not any("\\z{}" in format_latex(table) for table in report.tables)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (("runs/single",), "--out"),
        (("--out", "new"), "RUN"),
        (("runs/single", "--out", "out"), "expected a new or empty folder to write to, found something there"),
        (("runs/single", "runs/single", "--out", "new"), "expected every run once"),
        (("runs/single", "other", "--out", "new"), "expected runs of one suite"),
        (("runs/single", "runs/nothing", "--out", "new"), "expected a folder that `mdrive-sumo eval` has written"),
        (("runs/single", "--out", "new", "--with-published"), "expected a suite of the paper's buckets"),
        (("runs/single", "--out", "new", "--baseline", "sngle"), "did you mean 'single'?"),
    ],
)
def test_bad_input_is_one_sentence(
    out: Path, given: tuple[str, ...], sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(out.parent)
    if not Path("other").exists():
        save_run(Path("other"), make_agent_run("a", BEST, suite_checksum="sha256:2"))
    ended = invoke("report", *given)
    assert ended.exit_code == 2 and sentence in ended.output.replace("\n", " ")
    assert not Path("new").exists()


def test_replays_are_written_and_led_to(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def build(_: object, result: ScenarioResult) -> str:
        return result.id

    monkeypatch.setattr(replay_files, "build_replay", build)
    run = make_run(tmp_path)
    for selection, names in (("lost", {"s0", "s2"}), ("all", {"s0", "s1", "s2"})):
        folder = tmp_path / selection
        ended = invoke("report", run, "--out", folder, "--replays", selection)
        assert ended.exit_code == 0, ended.output
        links = {link for link in _PageParts((folder / "report.html").read_text("utf-8")).links if "view" in link}
        assert {(folder / link).read_text() for link in links} == names
    results = out.parent / "runs" / "single" / "results.json"
    ended = invoke("report", results, "--out", tmp_path / "new", "--replays", "lost")
    assert ended.exit_code == 2 and "expected folders of runs with it, found the file" in ended.output
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_fits_screens(out: Path) -> None:
    messages: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list_flags())
        page = browser.new_page()
        page.on("console", lambda message: messages.append(message.text))
        page.goto((out / "report.html").as_uri())
        for width, height in ((1440, 900), (390, 844)):
            page.set_viewport_size({"width": width, "height": height})
            wait_until(page, f"document.documentElement.scrollWidth === {width}")  # a busy machine lays out late
        is_dark = {scheme: find_dark_parts(page, scheme) for scheme in ("light", "dark")}
        place = page.evaluate("getComputedStyle(document.querySelector('td.rank-1 > span')).fontWeight")
        browser.close()
    assert is_dark == {"light": [False, False, True], "dark": [True, True, False]}
    assert place == "750" and messages == []


def find_dark_parts(page: Page, scheme: Literal["light", "dark"]) -> list[bool]:
    """Return whether the page, a section and the text of a figure are dark."""
    page.emulate_media(color_scheme=scheme)
    colours = page.evaluate("""() => [
        getComputedStyle(document.body).backgroundColor,
        getComputedStyle(document.querySelector("section")).backgroundColor,
        getComputedStyle(document.querySelector(".picture svg")).fill,
    ]""")
    return [sum(map(int, re.findall(r"\d+", colour)[:3])) < 3 * 128 for colour in colours]
