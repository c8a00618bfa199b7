"""The comparison of runs: rows, differences, links into replays in step, and what cannot be compared."""

import re
from pathlib import Path

import pytest
from testing import suite_fakes
from testing.html_page import Page
from testing.view_runs import HIT, HOSTILE, edit_results, hit, lose, make_run, succeed

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.run_page.comparison_data import (
    ComparedRun,
    build_comparison_data,
    find_telling_seeds,
    load_compared_runs,
)
from mdrive_sumo.report.run_page.comparison_files import name_in_step_file, select_pairs
from mdrive_sumo.report.run_page.replay_files import ReplaySelection
from mdrive_sumo.report.run_page.run_page import render_comparison_page
from mdrive_sumo.runs.compare import compare
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult


def drive_other(job: EpisodeJob) -> ScenarioResult:
    """s0 succeeds with seed 1 only, s1 hits a vehicle, s2 does nothing; 10 N + M is the route completion of sN."""
    result = suite_fakes.drive(job)
    if job.scenario == "s0" and job.seed == 1:
        return succeed(result)
    return lose(result, hit(HOSTILE)) if job.scenario == "s1" else result


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("two")
    other = make_run(folder, "--seeds", "2", "--comm", "realistic", name="other", drive=drive_other)
    return make_run(folder, "--seeds", "2"), other


@pytest.fixture(scope="module")
def runs(folders: tuple[Path, Path]) -> tuple[ComparedRun, ...]:
    return load_compared_runs(folders, None)


@pytest.fixture(scope="module")
def html(runs: tuple[ComparedRun, ...], tmp_path_factory: pytest.TempPathFactory) -> str:
    links = {(scenario, "B"): name_in_step_file(scenario, "B") for scenario in ("s0", "s1")}
    return render_comparison_page(build_comparison_data(runs, links, tmp_path_factory.mktemp("page") / "x.html"))


@pytest.mark.slow
def test_the_worst_difference_is_first(runs: tuple[ComparedRun, ...], tmp_path: Path) -> None:
    data = build_comparison_data(runs, {}, tmp_path)
    found = [(row.id, round(row.worst, 6), row.cells[1].outcome) for row in data.rows]
    assert found == [("s1", -93.7, "worse"), ("s2", 8.2, "better"), ("s0", 49.7, "better")]
    (comparison,) = data.comparisons
    a, b = (run.stored.results for run in runs)
    assert comparison == compare(a, b, (runs[0].folder, runs[1].folder))  # the statistics are those of `compare`
    assert [pair.scenario for pair in comparison.pairs] == [row.id for row in data.rows]


def test_replays_are_of_the_seed_that_differs_most(runs: tuple[ComparedRun, ...]) -> None:
    assert find_telling_seeds(runs) == {("s0", "B"): 1, ("s1", "B"): 0, ("s2", "B"): 1}
    assert [*select_pairs(runs, ReplaySelection.LOST)] == [("s0", "B"), ("s1", "B"), ("s2", "B")]
    same = (runs[0], ComparedRun("B", runs[0].folder, runs[0].stored))
    assert select_pairs(same, ReplaySelection.LOST) == {} and len(select_pairs(same, ReplaySelection.ALL)) == 3
    assert select_pairs(runs, ReplaySelection.NONE) == {}


def test_the_page_has_statistics_settings_and_links(html: str, runs: tuple[ComparedRun, ...]) -> None:
    page = Page(html)
    ds = compare(runs[0].stored.results, runs[1].stored.results).ds
    assert f"{ds.mean:+.2f}" in page.text
    assert ds.ends is None and "too few for an interval" in page.text
    assert re.search(r"latency_ticks\s+0\s+2", page.text)
    links = [str(one["href"]) for one in page.all("a")]
    assert links.count("s0-AB.html") == 1 and f"s0-AB.html#t={HIT / 20:.2f}" in links
    assert not any(link.startswith("s2-") for link in links)
    seeds = [one for one in page.all("li") if one.get("data-key") == "A"]
    assert not seeds  # filters are about the differences from the first run


def test_texts_stay_texts(html: str) -> None:
    page = Page(html)
    assert len(page.all("script")) == 1 and not page.all("img")
    assert "hit vehicle </script>" in page.text and "default-src 'none'" in html


def test_runs_of_two_versions_are_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    other = folders[1].with_name(f"{tmp_path.name}-other")  # beside its suite, to which its journal has a relative path
    other.mkdir()
    for name in ("results.json", "journal.jsonl"):
        (other / name).write_bytes((folders[1] / name).read_bytes())
    edit_results(other, lambda content: content["run"]["versions"].update(numpy="0.1"))
    with pytest.raises(InputError, match=r"the same versions, found .*; `mdrive-sumo compare` compares their scores"):
        load_compared_runs((folders[0], other), None)


def test_runs_of_two_seasons_are_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    seasons: list[Path] = []
    for number, folder in enumerate(folders):
        seasons.append(folder.with_name(f"{tmp_path.name}-season-{number}"))
        seasons[-1].mkdir()
        for name in ("results.json", "journal.jsonl"):
            (seasons[-1] / name).write_bytes((folder / name).read_bytes())
        edit_results(seasons[-1], lambda content, number=number: content["run"].update(suite=f"interaction@{number}"))
    sentence = r"view: expected runs of one season, found interaction@0 in .* and interaction@1 in .*; `mdrive-sumo"
    with pytest.raises(InputError, match=sentence):
        load_compared_runs(seasons, None)


def test_runs_of_two_suites_or_score_modes_are_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    suite_fakes.make_suite(tmp_path / "suite", "answer", "answer")
    other = make_run(tmp_path)
    with pytest.raises(InputError, match=r"the same suite, found tiny .* and tiny .*; runs of one suite"):
        load_compared_runs((folders[0], other), None)
    with pytest.raises(InputError, match=r"expected different runs, found .* twice"):
        load_compared_runs((other, tmp_path / "." / "run"), None)
    scored = make_run(
        tmp_path, "--score-mode", "interdrive_asis", name="scored", drive=lambda job: succeed(suite_fakes.drive(job))
    )
    with pytest.raises(InputError, match="the same score mode, found mdrive in"):
        load_compared_runs((other, scored), None)
