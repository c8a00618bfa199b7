"""The page of a run: its rows, links, texts, and that nothing breaks out of it."""

import re
from pathlib import Path

import pytest
from testing.html_page import Page
from testing.view_runs import HIT, HOSTILE, make_run

from mdrive_sumo.report.run_page.run_page import render_run_page
from mdrive_sumo.report.run_page.run_page_data import RunPageData, build_run_page_data
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import ScenarioResult, make_void_result

REACHING_OUT = r"https?:|//[a-z]+\.|@import|url\(|<link(?! rel=\"icon\" href=\"data:,\")|\bsrc=\"|\bimport\b"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("story"), "--seeds", "2")


@pytest.fixture(scope="module")
def data(run: Path) -> RunPageData:
    stored = load_stored_run(run)
    return build_run_page_data(stored, {("s0", 1): (), ("s2", 0): ()}, run / "view" / "index.html")


@pytest.fixture(scope="module")
def html(data: RunPageData) -> str:
    return render_run_page(data)


def test_the_worst_scenario_is_first_and_every_seed_is_a_cell(data: RunPageData) -> None:
    assert [(row.id, row.ds) for row in data.rows] == [("s0", 0.3), ("s2", 12.3), ("s1", 100.0)]
    assert [[(cell.seed, cell.ds, cell.outcome, cell.colour_step) for cell in row.cells] for row in data.rows] == [
        [(0, 0.0, "failed", 0), (1, 0.6, "failed", 0)],
        [(0, 12.0, "failed", 1), (1, 12.6, "failed", 1)],
        [(0, 100.0, "success", 10), (1, 100.0, "success", 10)],
    ]
    assert data.list_kinds() == ["agent-failed", "blocked", "collision-vehicle"]
    assert (data.failed_episodes, data.failed_cavs) == (2, 2)


def test_links_lead_to_the_tick_and_to_the_log(html: str, run: Path) -> None:
    links = [attributes["href"] for attributes in Page(html).all("a")]
    assert f"s0-seed1.html#t={HIT / 20:.2f}" in links and "s2-seed0.html" in links
    assert not [link for link in links if "s0-seed0" in str(link) or "s1-" in str(link)]  # they have no replay
    logs = [str(link) for link in links if str(link).endswith(".log")]
    assert logs == ["../logs/seed0/s2.0.log", "../logs/seed1/s2.0.log"]
    files = ["../results.json", "../report.md", "../journal.jsonl"]
    assert set(files) < set(links)
    assert all((run / "view" / file).resolve().is_file() for file in (*logs, *files))


def test_texts_stay_texts(html: str) -> None:
    """Ids, descriptions and errors come from files and agents."""
    page = Page(html)
    assert len(page.all("script")) == 1 and not page.all("img")
    assert "hit vehicle </script><script>document.title" in page.text and f"ValueError: {HOSTILE}" in page.text
    assert not re.findall(REACHING_OUT, html.replace(" src=x", ""))
    assert "default-src 'none'" in html


def test_the_page_names_what_the_run_was_made_of(html: str, data: RunPageData) -> None:
    text, run = Page(html).text, data.stored.results.run
    for value in (run.suite_checksum, "realistic", "preset ideal", f"numpy {run.versions['numpy']}", "0, 1"):
        assert value in text
    assert str(data.stored.run.fingerprint["code"]) in text
    assert "The agent failed in 2 of 6 episodes (2 CAVs)" in text


def test_the_same_run_gives_the_same_page(html: str, data: RunPageData, run: Path) -> None:
    again = build_run_page_data(load_stored_run(run), {("s0", 1): (), ("s2", 0): ()}, run / "view" / "index.html")
    assert again == data and render_run_page(again) == html


def test_void_episodes_and_runs_without_recordings(tmp_path: Path) -> None:
    def drive(job: EpisodeJob) -> ScenarioResult:
        scenario = load_suite(str(job.suite_folder)).select(job.scenario)[0]
        return make_void_result(scenario, job.seed, "SUMO ended")

    run = make_run(tmp_path, "--no-record", drive=drive)
    data = build_run_page_data(load_stored_run(run), {}, tmp_path / "elsewhere.html")
    assert {cell.outcome for cell in data.cells} == {"void"}
    text = Page(render_run_page(data)).text
    assert "made with --no-record: there are no replays" in text and "SUMO ended" in text
