"""`view`: the page of a run, the comparison of runs, their replays, and what is refused."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing import suite_fakes
from testing.html_page import Page
from testing.view_runs import drive_story, make_run, succeed

from mdrive_sumo.cli import main
from mdrive_sumo.cli.view import RUN_PAGE
from mdrive_sumo.report.run_page import comparison_files, replay_files
from mdrive_sumo.report.run_page.comparison_data import ComparedRun
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import EpisodeKey, ScenarioResult


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its recordings are empty: replays are made by `replays`."""
    return make_run(tmp_path_factory.mktemp("story"))


@pytest.fixture
def replays(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The scenarios whose replay page was built."""
    built: list[str] = []

    def build(_: Any, result: Any) -> str:
        built.append(result.id)
        return "a replay"

    for module in (replay_files, comparison_files):
        monkeypatch.setattr(module, "build_replay", build)
    monkeypatch.setattr("mdrive_sumo.cli.view.read_replays", lambda _, results: {one.key: () for one in results})
    return built


def read_links(path: Path) -> set[str]:
    return {str(one["href"]).partition("#")[0] for one in Page(path.read_text()).all("a")} - {""}


def test_the_page_of_a_run_opens_with_the_replays_of_what_was_lost(
    run: Path, replays: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: not opened.append(url))
    page = run / "view" / RUN_PAGE
    done = call("view", run)
    assert (done.exit_code, done.output, opened) == (0, f"{page}\n", [page.as_uri()])
    assert replays == ["s0", "s2"] and {"s0.html", "s2.html"} <= read_links(page)
    assert "s1.html" not in read_links(page)


@pytest.mark.parametrize(("selection", "expected"), [("all", ["s0", "s1", "s2"]), ("none", [])])
def test_replays_are_chosen(run: Path, replays: list[str], selection: str, expected: list[str]) -> None:
    assert call("view", run, "--no-open", "--replays", selection).exit_code == 0
    assert replays == expected
    linked = read_links(run / "view" / RUN_PAGE)
    assert {link for link in linked if link.endswith(".html")} == {f"{name}.html" for name in expected}


def test_an_exported_page_stands_alone(run: Path, tmp_path: Path, replays: list[str]) -> None:
    path = tmp_path / "x" / "page.html"
    assert call("view", run, "--export", path).exit_code == 0
    assert replays == [] and read_links(path) == set()
    assert "Written without replays" in Page(path.read_text()).text
    assert "logs/s2.0.log" in path.read_text() and str(run) not in path.read_text()


def test_a_run_without_recordings_has_a_page(tmp_path: Path, replays: list[str]) -> None:
    run = make_run(tmp_path, "--no-record")
    assert call("view", run, "--no-open").exit_code == 0
    assert replays == [] and "made with --no-record" in (run / "view" / RUN_PAGE).read_text()
    done = call("view", run, "--no-open", "--scenario", "s0")
    assert done.exit_code == 2 and "found one made with --no-record" in done.stderr


def test_a_missing_recording_is_one_sentence(tmp_path: Path, replays: list[str]) -> None:
    run = make_run(tmp_path)
    (run / "episodes" / "s2.npz").unlink()
    done = call("view", run, "--no-open")
    assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1)
    assert "s2.npz: expected the recording of s2, found none; --replays none" in done.stderr
    assert not replays and call("view", run, "--no-open", "--replays", "none").exit_code == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--scenario", "dead"), "expected a scenario id or category like 'dead', found none; did you mean 'deed'?"),
        (("--seed", "0"), "--seed: expected a --scenario with it"),
        (("--replays", "all", "--export", "x.html"), "--replays: expected neither --scenario nor --export"),
        (("--replays", "some"), "expected one of lost, all, none, found 'some'"),
        (("--export", "/proc/nowhere/x.html"), "/proc/nowhere"),
    ],
)
def test_what_view_refuses(run: Path, words: tuple[str, ...], sentence: str) -> None:
    done = call("view", run, *words)
    assert (done.exit_code, sentence in done.stderr) == (2, True), done.stderr


def test_an_empty_run_is_one_sentence(run: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    (empty / "journal.jsonl").write_bytes((run / "journal.jsonl").read_bytes().splitlines(keepends=True)[0])
    done = call("view", empty)
    assert done.exit_code == 2 and "expected at least one finished episode, found 0 of 3" in done.stderr


@pytest.fixture(scope="module")
def other(run: Path) -> Path:
    """A run of the same suite in which s0 succeeds."""
    return make_run(run.parent, name="other", drive=drive_better)


def drive_better(job: EpisodeJob) -> ScenarioResult:
    return succeed(suite_fakes.drive(job)) if job.scenario == "s0" else drive_story(job)


@pytest.fixture
def in_step(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The scenarios and runs whose replays were put in step."""
    built: list[tuple[str, ...]] = []

    def render(runs: Sequence[ComparedRun], _: object, key: EpisodeKey) -> str:
        built.append((key[0], *(run.folder.name for run in runs)))
        return "two replays"

    monkeypatch.setattr(comparison_files, "_render", render)
    return built


def test_runs_are_compared(run: Path, other: Path, replays: list[str], in_step: list[tuple[str, ...]]) -> None:
    page = run / "view" / "with-other" / RUN_PAGE
    done = call("view", run, other, "--no-open")
    assert (done.exit_code, done.output) == (0, f"{page}\n")
    assert in_step == [("s0", "run", "other")] and replays == ["s0", "s0"]
    assert {link for link in read_links(page) if link.endswith(".html")} == {"s0-AB.html"}
    assert (page.parent / "s0-AB.html").read_text() == "two replays"
    assert call("view", run, other, "--no-open", "--replays", "none").exit_code == 0 and len(in_step) == 1


def test_two_replays_of_a_scenario(run: Path, other: Path, replays: list[str], in_step: list[tuple[str, ...]]) -> None:
    done = call("view", run, other, "--no-open", "--scenario", "s1")
    assert (done.exit_code, done.output) == (0, f"{run / 'view' / 'with-other' / 's1-AB.html'}\n")
    assert in_step == [("s1", "run", "other")] and replays == ["s1", "s1"]


@pytest.mark.slow
def test_three_runs_share_the_first_replay(
    run: Path, other: Path, replays: list[str], in_step: list[tuple[str, ...]]
) -> None:
    third = make_run(run.parent, "--no-record", name="third", drive=drive_better)
    page = run / "view" / "with-other+third" / RUN_PAGE
    assert call("view", run, other, third, "--no-open").exit_code == 0
    assert len(in_step) == 1 and "so without replays: C." in page.read_text()
    (third / "journal.jsonl").write_bytes((other / "journal.jsonl").read_bytes())  # as if it were recorded
    shutil.copytree(other / "episodes", third / "episodes")
    replays.clear()
    assert call("view", run, other, third, "--no-open").exit_code == 0
    assert in_step[1:] == [("s0", "run", "other"), ("s0", "run", "third")] and replays == ["s0"] * 3


def test_a_scenario_that_only_one_run_has_driven(run: Path) -> None:
    one = make_run(run.parent, "--scenario", "s1", "--seed", "3", name="one")
    for scenario, sentence in (("s0", "one has driven, found none;"), ("s1", "found seeds 3 of it; --seed chooses")):
        done = call("view", run, one, "--no-open", "--scenario", scenario)
        assert (done.exit_code, sentence in done.stderr) == (2, True), done.stderr
    done = call("view", run, one, "--no-open")
    assert done.exit_code == 0, done.stderr
    assert "warning: " not in done.output and "s0: only in A" in (run / "view" / "with-one" / RUN_PAGE).read_text()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("run", "other", "other", "--scenario", "s0"), "--scenario: expected one RUN or two with it, found 3"),
        (("run", "run"), "expected different runs, found"),
        (("run", "nothing"), "found no such folder"),
        (("run", "other", "--scenario", "dead"), "did you mean 'deed'?"),
        (("run", "other", "--scenario", "s0", "--seed", "7"), "--seed: expected one of the run's, 0, found 7"),
    ],
)
def test_what_a_comparison_refuses(
    run: Path, other: Path, words: tuple[str, ...], sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    done = call("view", *words)
    assert (done.exit_code, sentence in done.stderr) == (2, True), done.stderr
    assert other.is_dir()
