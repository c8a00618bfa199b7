"""Runs that are going on or were interrupted: every command that reads results shows them, marked as partial."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.journals import rewrite_journal
from testing.view_runs import make_run

import mdrive_sumo as md
from mdrive_sumo.cli import main, view
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import JOURNAL_FILE, open_journal, read_fingerprint
from mdrive_sumo.runs.run_folder import load_run_results

MARK = "partial: 2 of 3"


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("finished"))


def interrupt(run: Path, folder: Path, episodes: int) -> Path:
    """Copy a run, with the suite beside it, as it was when so many episodes were finished."""
    shutil.copytree(run, folder)
    shutil.copytree(run.parent / "suite", folder.parent / "suite", dirs_exist_ok=True)
    (folder / "results.json").unlink()
    lines = (folder / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    (folder / JOURNAL_FILE).write_bytes(b"".join(lines[: 1 + episodes]))
    return folder


@pytest.fixture
def partial(finished: Path, tmp_path: Path) -> Path:
    return interrupt(finished, tmp_path / "partial", 2)


def test_results_of_a_part_say_how_much_they_are(finished: Path, partial: Path) -> None:
    results = load_run_results(partial)
    whole = load_run_results(finished)
    assert (len(results.scenarios), results.planned, whole.planned) == (2, 3, None)
    assert results.run.agent == whole.run.agent
    assert {one.id for one in results.scenarios} < {one.id for one in whole.scenarios}
    assert "planned" not in whole.model_dump(mode="json")
    assert len(md.load_run(partial).scores) == 2


@pytest.mark.slow
def test_every_reading_command_marks_a_partial_run(finished: Path, partial: Path, tmp_path: Path) -> None:
    listed = call("list", "runs", tmp_path)
    assert MARK in listed.output
    compared = call("compare", finished, partial)
    assert (compared.exit_code, compared.exception) == (0, None)
    assert "warning: B is partial: 2 of 3 episodes are finished" in compared.output
    assert "2 scenarios in both" in compared.output
    reported = call("report", partial, "--out", tmp_path / "report")
    assert reported.exit_code == 0, reported.output
    assert f"({MARK})" in reported.output
    for name in ("report.md", "report.html", "csv/main.csv", "latex/main.tex"):
        assert MARK in (tmp_path / "report" / name).read_text(), name
    viewed = call("view", partial, "--no-open", "--replays", "none")
    assert viewed.exit_code == 0, viewed.output
    page = (partial / "view" / "index.html").read_text()
    assert page.count(MARK) >= 3  # title, heading, line
    assert 'http-equiv="refresh"' not in page
    beside = call("view", finished, partial, "--no-open", "--replays", "none")
    assert MARK in Path(beside.output.strip()).read_text()


@pytest.mark.slow
def test_a_report_of_partial_runs_is_over_what_all_have(finished: Path, tmp_path: Path) -> None:
    other = interrupt(finished, tmp_path / "other", 1)
    done = call("report", other, "--out", tmp_path / "report", "--baseline", load_run_results(other).run.agent)
    assert done.exit_code == 0, done.output
    assert "note: Runs are partial: all numbers are over the 1 scenarios that every run has finished." in done.output


def test_what_needs_a_finished_run_says_so(partial: Path) -> None:
    for command in (("verify", partial), ("rescore", partial, "--mode", "hard"), ("export", partial, "--to", "csv")):
        done = call(*command)
        assert done.exit_code == 2 or isinstance(done.exception, InputError), command


def test_a_run_without_a_finished_episode_is_a_sentence(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected at least one finished episode, found 0 of 3"):
        load_run_results(interrupt(finished, tmp_path / "none", 0))


@pytest.mark.parametrize(
    "change",
    [
        lambda header: header.pop("about"),
        lambda header: header["about"].pop("run"),
        lambda header: header["about"].update(episodes="many"),
        lambda header: header["about"]["run"].pop("suite"),
        lambda header: header.update(about=3),
    ],
)
def test_a_journal_that_does_not_describe_its_run_is_a_sentence(
    partial: Path, change: Callable[[dict[str, object]], object]
) -> None:
    def edit(line: str) -> str:
        content = json.loads(line)
        if "fingerprint" in content:
            change(content)
        return json.dumps(content)

    rewrite_journal(partial / JOURNAL_FILE, edit)
    with pytest.raises(InputError):
        load_run_results(partial)


def test_readers_do_not_hold_up_the_writer(partial: Path) -> None:
    """They read while the journal is locked, also in the middle of a line, and the writer goes on."""
    fingerprint = read_fingerprint(partial)
    with open_journal(partial, fingerprint, fresh=False) as journal:
        assert len(load_run_results(partial).scenarios) == 2
        with (partial / JOURNAL_FILE).open("ab") as torn:
            torn.write(b'{"result":{"id":"s')
        assert len(load_run_results(partial).scenarios) == 2
        assert call("list", "runs", partial).exit_code == 0
        assert journal.results


def test_a_live_page_is_written_anew_until_the_run_is_finished(
    finished: Path, partial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages: list[str] = []

    def wait(_: float) -> None:
        """An episode finishes meanwhile, then the run."""
        pages.append((partial / "view" / "index.html").read_text())
        shutil.copy(finished / JOURNAL_FILE, partial / JOURNAL_FILE)
        if len(pages) > 1:
            shutil.copy(finished / "results.json", partial / "results.json")

    monkeypatch.setattr(view, "_sleep", wait)
    done = call("view", partial, "--live", "--no-open", "--replays", "none")
    assert done.exit_code == 0, done.output
    assert done.output == f"{partial / 'view' / 'index.html'}\n"
    pages.append((partial / "view" / "index.html").read_text())
    assert ["partial: 2 of 3" in page for page in pages] == [True, False, False]
    assert ["partial: 3 of 3" in page for page in pages] == [False, True, False]
    assert ['<meta http-equiv="refresh"' in page for page in pages] == [True, True, False]


def test_ctrl_c_ends_the_live_page_and_nothing_else(partial: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(view, "_sleep", interrupted)
    assert call("view", partial, "--live", "--no-open", "--replays", "none").exit_code == 0


def test_a_live_page_is_of_one_run(finished: Path, partial: Path) -> None:
    done = call("view", finished, partial, "--live")
    assert (done.exit_code, "--live: expected one RUN" in done.output) == (2, True)
