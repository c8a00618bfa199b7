"""`view RUN`: the page of a run, its replays, and what it refuses."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.html_page import Page
from testing.view_runs import make_run

from mdrive_sumo.cli import main
from mdrive_sumo.cli.view import RUN_PAGE
from mdrive_sumo.report.run_page import replay_files


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

    monkeypatch.setattr(replay_files, "build_replay", build)
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
    assert "This page stands alone" in Page(path.read_text()).text
    assert str(run / "logs" / "s2.0.log") in path.read_text()


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
    (empty / "journal.jsonl").write_bytes((run / "journal.jsonl").read_bytes())
    done = call("view", empty)
    assert done.exit_code == 2 and "expected a finished run, found an interrupted one" in done.stderr
