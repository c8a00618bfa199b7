"""The commands that look at things: list, show, view, schema, compare."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import main
from mdrive_sumo.scenario.suite import load_suite

pytestmark = pytest.mark.usefixtures("in_process")


def call(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one scenario in which no vehicle moves: blocked after 30 s."""
    folder = tmp_path_factory.mktemp("run")
    first = load_suite("interdrive@0").scenarios[0].id
    done = call(
        "eval", "--suite", "interdrive@0", "--agent", "stationary", "--scenario", first, "--workers", 1, "--out", folder
    )
    assert done.exit_code == 0, done.output
    return folder


@pytest.mark.slow
def test_list_suites_shows_our_statistics_beside_the_papers() -> None:
    rows = [line.split() for line in call("list", "suites").output.splitlines()]
    ours = next(row for row in rows if " ".join(row).startswith("interdrive@"))
    assert ["in", "the", "paper", "46", "175", "3.80", "51.83", "65.85", "0.00"] in rows
    assert ours[1] == "46"
    assert any(row[:2] == ["ins_crosschange", "4"] for row in rows)


def test_list_scenarios_has_a_row_for_each() -> None:
    table, legend = call("list", "scenarios", "--suite", "interdrive@0").output.split("\n\n")
    rows = table.splitlines()[2:]
    assert legend.startswith("hidden:")
    assert [s.id for s in load_suite("interdrive@0").scenarios] == [row.split()[0] for row in rows]


@pytest.mark.slow
def test_list_agents_says_what_each_does() -> None:
    table, _, legend = call("list", "agents").output.partition("\n\n")
    rows = [line.split(maxsplit=2) for line in table.splitlines()[2:]]
    assert all(len(text) > 10 for _, _, text in rows) and legend.startswith("track: sensor: ")
    tracks = {name: track for name, track, _ in rows}
    assert (
        tracks.items()
        >= {"stationary": "sensor", "idm": "object", "colmdriver": "object", "omniscient": "object"}.items()
    )


@pytest.mark.slow
def test_list_networks_says_whether_signs_are_known() -> None:
    rows = [line.split() for line in call("list", "networks").output.splitlines()[2:]]
    assert len(rows) >= 6
    assert all(row[3].isdecimal() or row[3] == "unknown" for row in rows)


def test_list_of_a_suite_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    done = call("list", "scenarios", "--suite", tmp_path / "nothing")
    assert done.exit_code == 2
    assert done.stderr.startswith("Error: suite ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("what", ["results", "contract", "scenario", "network", "suite"])
def test_schema_is_json(what: str) -> None:
    assert isinstance(json.loads(call("schema", what).output), dict)


@pytest.mark.slow
def test_show_draws_a_picture(tmp_path: Path) -> None:
    first = load_suite("interdrive@0").scenarios[0].id
    done = call("show", first, "--suite", "interdrive@0", "--out", tmp_path / "x.png")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_show_refuses_a_glob_that_fits_several() -> None:
    done = call("show", "*", "--suite", "interdrive@0")
    assert (done.exit_code, "to fit one scenario, found 46" in done.stderr) == (2, True)


def test_show_refuses_an_ending_that_is_no_picture(tmp_path: Path) -> None:
    first = load_suite("interdrive@0").scenarios[0].id
    done = call("show", first, "--suite", "interdrive@0", "--out", tmp_path / "x.docx")
    assert (done.exit_code, "cannot be written" in done.stderr) == (2, True)


@pytest.mark.slow
def test_view_exports_one_page_without_links(run_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.html"
    first = load_suite("interdrive@0").scenarios[0].id
    done = call("view", run_folder, "--scenario", first, "--export", path)
    assert (done.exit_code, done.output) == (0, f"{path}\n")
    page = path.read_text()
    assert first in page
    assert "http://" not in page
    assert "https://" not in page


@pytest.mark.slow
def test_view_opens_the_page_in_a_browser(run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: not opened.append(url))
    first = load_suite("interdrive@0").scenarios[0].id
    assert call("view", run_folder, "--scenario", first).exit_code == 0
    page = run_folder / "view" / f"{first}.html"
    assert opened == [page.as_uri()]
    assert page.is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--scenario", "nothing-like-it"), "expected a scenario id or category like"),
        (("--scenario", "*"), "to fit one scenario"),
        (("--export", "/proc/nowhere/x.html"), "/proc/nowhere"),
    ],
)
def test_view_says_what_is_wrong(run_folder: Path, arguments: tuple[str, ...], sentence: str) -> None:
    done = call("view", run_folder, *arguments)
    assert (done.exit_code, sentence in done.stderr) == (2, True)


@pytest.mark.slow
def test_view_of_a_scenario_that_the_run_did_not_drive(run_folder: Path) -> None:
    done = call("view", run_folder, "--scenario", load_suite("interdrive@0").scenarios[1].id)
    assert (done.exit_code, "found one outside its --scenario; `mdrive-sumo eval --scenario" in done.stderr) == (
        2,
        True,
    )


@pytest.mark.slow
def test_compare_of_a_run_with_itself_is_all_ties(run_folder: Path) -> None:
    done = call("compare", run_folder, run_folder / "results.json")
    assert done.exit_code == 0
    assert "B is better in 0, as good in 1, worse in 0" in done.output
    assert "warning" not in done.output


def test_compare_with_a_folder_that_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    done = call("compare", tmp_path, tmp_path)
    assert (done.exit_code, len(done.stderr.splitlines())) == (2, 1)
