"""A report leads from the scores of scenarios to their replays."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from testing.chromium import CHROMIUM, open_quietly, wait_until
from testing.html_page import Page
from testing.report_samples import SINGLE, make_agent_run, save_run
from testing.view_runs import drive_story, make_run
from testing.viewer_crossing import crossing, record, scenario, some_marks

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.report.comparison_report.compared_agent import make_compared_agents
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport, build_comparison_report
from mdrive_sumo.report.comparison_report.replay_pages import find_replay_links
from mdrive_sumo.report.comparison_report.report_runs import load_report_runs
from mdrive_sumo.report.comparison_report.write_comparison_report import (
    ReportLinks,
    format_report_markdown,
    render_report_page,
)
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.stored_run import load_viewed_run
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import ScenarioResult, make_void_result

ALL_SEEDS = {"../run/view/s0-seed0.html", "../run/view/s1-seed0.html", "../run/view/s2-seed0.html"}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run of two seeds, whose DS are lower with seed 0."""
    folder = tmp_path_factory.mktemp("home of the runs")
    make_run(folder, "--seeds", "2")
    return folder


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(home)
    yield
    for page in home.glob("*/view/*.html"):
        page.unlink()


def write_pages(run: Path, *names: str) -> None:
    (run / "view").mkdir(exist_ok=True)
    for name in names:
        write_text(run / "view" / f"{name}.html", "a replay")


def build(*places: Path) -> ComparisonReport:
    return build_comparison_report(make_compared_agents(load_report_runs(places)))


def render(report: ComparisonReport, out: Path) -> Page:
    links = ReportLinks({}, {}, find_replay_links(report.tables, out))
    return Page(render_report_page(report, {one.name: b"<svg></svg>" for one in report.figures}, links))


def list_links(page: Page) -> list[str]:
    return [link for one in page.all("a") if not (link := str(one["href"])).startswith("#")]


def test_a_score_leads_to_the_replay_of_its_worst_seed() -> None:
    write_pages(Path("run"), "s0-seed0", "s0-seed1", "s1-seed0", "s2-seed0")
    page = render(build(Path("run")), Path("report"))
    assert list_links(page) == [*list_links(page)[:3]] * 2 and {*list_links(page)} == ALL_SEEDS, "DS and SR"
    assert page.text.count("Underlined scores lead to their replay") == 2 and "not written" not in page.text
    assert {one["title"] for one in page.all("a") if "title" in one} == {
        f"Replay of s{i}, stationary" for i in range(3)
    }


def test_replays_that_are_not_written_have_no_link_but_a_command() -> None:
    write_pages(Path("run"), "s0-seed1", "s2-seed0")
    page = render(build(Path("run")), Path("report"))
    assert {*list_links(page)} == {"../run/view/s2-seed0.html"}
    assert "2 of 3 replays are not written:" in page.text and "mdrive-sumo view RUN" in page.text
    write_pages(Path("run"), "s0-seed0")
    assert len({*list_links(render(build(Path("run")), Path("report")))}) == 2, "what exists when the page is written"


def test_links_are_of_the_page_only() -> None:
    report = build(Path("run"))
    before = format_report_markdown(report)
    write_pages(Path("run"), "s0-seed0")
    assert format_report_markdown(build(Path("run"))) == before and "replay" not in before


def test_results_without_recordings_say_nothing_of_replays(tmp_path: Path) -> None:
    page = render(build(save_run(tmp_path / "run", make_agent_run("a", SINGLE))), tmp_path / "report")
    assert list_links(page) == [] and "eplay" not in page.text


@pytest.mark.parametrize(
    ("start", "place", "out", "expected"),
    [
        (".", "run", "report", "../run/view/s0-seed0.html"),
        (".", "run", "deep/report", "../../run/view/s0-seed0.html"),
        (".", "run", "run/report", "../view/s0-seed0.html"),
        (".", "{home}/run", "{home}/report", "../run/view/s0-seed0.html"),
        ("..", "home%20of/run", "report", "../home%20of/run/view/s0-seed0.html"),
        (".", "run", "{home}/../elsewhere/report", ""),
        ("..", "{home}/run", "{home}/report", "../run/view/s0-seed0.html"),
    ],
)
def test_links_name_no_folder_that_the_report_does_not_name(
    home: Path, monkeypatch: pytest.MonkeyPatch, start: str, place: str, out: str, expected: str
) -> None:
    write_pages(Path("run"), "s0-seed0")
    monkeypatch.chdir(start)
    place, out = (text.replace("home%20of", home.name).format(home=home) for text in (place, out))
    expected = expected.replace("home%20of", home.name.replace(" ", "%20"))
    page = render(build(Path(place)), Path(out))
    assert {*list_links(page)} == ({expected} if expected else set())
    assert ("1 replays have no link" in page.text) == (not expected)


def test_links_of_a_strangers_run_stay_inside(home: Path, tmp_path: Path) -> None:
    """A run with links is refused when it is read; links that come later have no link in the report."""
    write_pages(Path("run"), "s1-seed0", "s2-seed0")
    report = build(Path("run"))
    secret, page = tmp_path / "secret.html", home / "run" / "view" / "s0-seed0.html"
    secret.write_text("secret")
    page.symlink_to(secret)
    assert {*list_links(render(report, Path("report")))} == ALL_SEEDS - {"../run/view/s0-seed0.html"}
    with pytest.raises(InputError, match=r"s0-seed0\.html: expected a run of regular files and folders, found a link"):
        build(Path("run"))
    page.unlink()
    (home / "run" / "view").rename(home / "pages")
    (home / "run" / "view").symlink_to(home / "pages")
    try:
        assert list_links(render(report, Path("report"))) == []
    finally:
        (home / "run" / "view").unlink()
        (home / "pages").rename(home / "run" / "view")


def test_a_name_that_leads_out_of_a_run_has_no_link(tmp_path: Path) -> None:
    drives = make_agent_run("a", SINGLE)
    moved = drives.scenarios[0].model_copy(update={"id": "../out"})
    run = save_run(tmp_path / "run", drives.model_copy(update={"scenarios": (moved, *drives.scenarios[1:])}))
    for path in (run / "out.npz", run / "out.html"):
        path.touch()
    for folder in ("episodes", "view"):
        (run / folder).mkdir()
    assert list_links(render(build(run), tmp_path / "report")) == []


def drive_void(job: EpisodeJob) -> ScenarioResult:
    result = drive_story(job)
    (driven,) = load_suite(str(job.suite_folder)).select(job.scenario)
    return make_void_result(driven, job.seed, "SUMO stopped") if job.scenario == "s0" else result


def test_void_episodes_have_no_replay(tmp_path: Path) -> None:
    run = make_run(tmp_path, drive=drive_void)
    write_pages(run, "s0", "s1", "s2")
    assert len({*list_links(render(build(run), tmp_path / "report"))}) == 2


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_click_on_a_score_opens_its_replay(browser: Any, home: Path) -> None:
    write_pages(Path("run"))
    replay = render_replay(record(9), scenario(2), crossing(), some_marks(9))
    write_text(home / "run" / "view" / "s0-seed0.html", replay)
    report = build(Path("run"))
    links = ReportLinks({}, {}, find_replay_links(report.tables, home / "report"))
    page = render_report_page(report, {one.name: b"<svg></svg>" for one in report.figures}, links)
    (home / "report").mkdir()
    write_text(home / "report" / "report.html", page)
    for tab in open_quietly(browser, (home / "report" / "report.html").as_uri(), (1440, 900)):
        link = tab.locator("#scenarios_ds td a")
        cell = tab.locator("#scenarios_ds td", has=tab.locator("a"))
        assert link.bounding_box()["width"] == pytest.approx(cell.bounding_box()["width"], abs=1), "all of the cell"
        link.click()
        wait_until(tab, "window.viewer && viewer.ticks === 9")
        assert tab.url == (home / "run" / "view" / "s0-seed0.html").as_uri()


def test_what_is_written_into_a_partial_run_stays_there(home: Path, tmp_path: Path) -> None:
    """`view` and `report --replays` write into the folder of pages."""
    run = make_run(tmp_path)
    (run / "results.json").unlink()
    assert load_viewed_run(run).results.planned == 3
    (run / "view").symlink_to(home)
    with pytest.raises(InputError, match="expected a run of regular files and folders, found a link"):
        load_viewed_run(run)
